"""What the parts of a specimen must agree on, beyond the limits of each value."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from pydantic_core import PydanticCustomError

from softarm.estimator.errors import suggest
from softarm.estimator.specimen.body import AZIMUTH_TOLERANCE_RAD, Chamber, Section, Segment

if TYPE_CHECKING:
    from softarm.estimator.specimen.specimen import Specimen

HEIGHT_TOLERANCE_M = 1e-9
GRAVITY_MOST_M_S2 = 30.0
HEIGHT_MOST_M = 10.0
WIDTH_MOST_M = 2.0
MASS_MOST_KG = 50.0
MODULUS_LEAST_PA = 1e3
DENSITY_LEAST_KG_M3 = 10.0
PRESSURE_LEAST_PA = 100.0
"""Bounds that no soft arm reaches, unless its values are in mm/s2, millimetres, grams, kPa or g/cm3."""


@dataclass(frozen=True)
class Inconsistency:
    """A disagreement: the path of the field at fault, what is wrong and what to do."""

    field: str
    what: str
    cure: str


def raise_inconsistencies(specimen: "Specimen") -> None:
    """Raise all disagreements of a specimen as one validation error.

    Raises:
        PydanticCustomError: Of type ``inconsistent``; its context lists them under ``problems``.
    """
    problems = tuple(find_inconsistencies(specimen))
    if problems:
        raise PydanticCustomError(
            "inconsistent", "{count} inconsistencies", {"count": len(problems), "problems": problems}
        )


def find_inconsistencies(specimen: "Specimen") -> Iterator[Inconsistency]:
    """Find every disagreement between the parts of a specimen."""
    parts = [segment.name for segment in specimen.segments] + [section.name for section in specimen.sections]
    yield from _duplicates("segments and sections", parts)
    yield from _duplicates("markers", [marker.name for marker in specimen.markers])
    yield from _magnitudes(specimen)
    yield from _heights(specimen)
    yield from _stack(specimen)
    yield from _materials(specimen)
    yield from _chambers(specimen)
    yield from _geometry(specimen)
    yield from _references(specimen)
    yield from _rotations(specimen)


def _duplicates(where: str, names: Sequence[str]) -> Iterator[Inconsistency]:
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        yield Inconsistency(where, f"'{name}' occurs {names.count(name)} times", "give each its own name")


def _magnitudes(specimen: "Specimen") -> Iterator[Inconsistency]:
    """Find values that were probably given in another unit than that of their key."""
    gravity = math.hypot(*specimen.gravity_m_s2)
    if gravity > GRAVITY_MOST_M_S2:
        yield _wrong_unit("gravity_m_s2", f"its magnitude is {gravity:g}", "m/s2")
    for path, width in _widths(specimen):
        if width > WIDTH_MOST_M:
            yield _wrong_unit(path, f"{width:g} is too large for an arm", "metres")
    for part in specimen.named_parts:
        path = _path(specimen, part.name)
        if abs(part.to_m) > HEIGHT_MOST_M:
            yield _wrong_unit(f"{path}.to_m", f"{part.to_m:g} is too long for an arm", "metres")
        if (part.mass_kg or 0.0) > MASS_MOST_KG:
            yield _wrong_unit(f"{path}.mass_kg", f"{part.mass_kg:g} is too heavy for an arm", "kilograms")
    for i, chamber in enumerate(specimen.chambers):
        if chamber.pressure_limit_pa < PRESSURE_LEAST_PA:
            what = f"{chamber.pressure_limit_pa:g} is too little to move an arm"
            yield _wrong_unit(f"chambers[{i}].pressure_limit_pa", what, "pascals")
    yield from _material_magnitudes(specimen)


def _material_magnitudes(specimen: "Specimen") -> Iterator[Inconsistency]:
    for name, material in specimen.materials.items():
        if material.young < MODULUS_LEAST_PA:
            key = "young_modulus_pa" if material.law == "corotational" else "shear_modulus_pa"
            what = f"a Young's modulus of {material.young:g} is too soft for a solid"
            yield _wrong_unit(f"materials.{name}.{key}", what, "pascals")
        if material.density_kg_m3 < DENSITY_LEAST_KG_M3:
            what = f"{material.density_kg_m3:g} is too light for a solid"
            yield _wrong_unit(f"materials.{name}.density_kg_m3", what, "kg/m3")


def _widths(specimen: "Specimen") -> Iterator[tuple[str, float]]:
    """Yield the lengths across the arm [m], each with its field."""
    for key, value in specimen.geometry:
        if key.endswith(("radius_m", "wall_m", "core_m", "floor_m", "width_x_m", "width_y_m")):
            yield f"geometry.{key}", value
        elif key == "lobe_radii_m":
            yield f"geometry.{key}", max(value)
    for i, marker in enumerate(specimen.markers):
        yield f"markers[{i}].offset_m", math.hypot(*marker.offset_m)


def _wrong_unit(path: str, what: str, unit: str) -> Inconsistency:
    return Inconsistency(path, what, f"give it in {unit}")


def _heights(specimen: "Specimen") -> Iterator[Inconsistency]:
    spans: list[tuple[str, Segment | Section | Chamber, bool]] = [
        *((f"segments[{i}]", part, False) for i, part in enumerate(specimen.segments)),
        *((f"sections[{i}]", part, True) for i, part in enumerate(specimen.sections)),
        *((f"chambers[{i}]", part, False) for i, part in enumerate(specimen.chambers)),
    ]
    for path, part, may_be_face in spans:
        if part.to_m < part.from_m or (part.to_m == part.from_m and not may_be_face):
            yield Inconsistency(
                f"{path}.to_m", f"{part.to_m} m is not above from_m = {part.from_m} m", "swap or correct them"
            )


def _stack(specimen: "Specimen") -> Iterator[Inconsistency]:
    parts = specimen.parts
    for below, above in pairwise(parts):
        distance = above.from_m - below.to_m
        if abs(distance) > HEIGHT_TOLERANCE_M:
            yield Inconsistency(
                f"{_path(specimen, above.name)}.from_m",
                f"'{above.name}' begins at {above.from_m} m but '{below.name}' ends at {below.to_m} m",
                "let the parts follow one another without gap or overlap",
            )
    if not parts:
        return
    for name in [section.name for section in specimen.sections]:
        section = specimen.section(name)
        inside = parts[0].from_m <= section.from_m and section.to_m <= parts[-1].to_m
        if not inside:
            yield Inconsistency(
                _path(specimen, name), f"section '{name}' lies outside the body", "correct from_m and to_m"
            )
        if (section.material is None) != (section.from_m == section.to_m):
            yield Inconsistency(
                f"{_path(specimen, name)}.material",
                "a section with a length needs a material, a face has none",
                "add or remove the material",
            )


def _path(specimen: "Specimen", name: str) -> str:
    for index, segment in enumerate(specimen.segments):
        if segment.name == name:
            return f"segments[{index}]"
    return f"sections[{[section.name for section in specimen.sections].index(name)}]"


def _materials(specimen: "Specimen") -> Iterator[Inconsistency]:
    for part in specimen.named_parts:
        if part.material is not None and part.material not in specimen.materials:
            yield Inconsistency(
                f"{_path(specimen, part.name)}.material",
                f"no material '{part.material}'",
                _suggest(part.material, list(specimen.materials), "material"),
            )


def _chambers(specimen: "Specimen") -> Iterator[Inconsistency]:
    segments = {segment.name: segment for segment in specimen.segments}
    for position, chamber in enumerate(specimen.chambers):
        path = f"chambers[{position}]"
        if chamber.index != position:
            yield Inconsistency(
                f"{path}.index", f"{chamber.index} where {position} follows", "number the chambers from 0"
            )
        segment = segments.get(chamber.segment)
        if segment is None:
            yield Inconsistency(
                f"{path}.segment",
                f"no segment '{chamber.segment}'",
                _suggest(chamber.segment, list(segments), "segment"),
            )
        elif chamber.from_m < segment.from_m or chamber.to_m > segment.to_m:
            yield Inconsistency(
                path,
                f"{chamber.from_m} to {chamber.to_m} m leaves segment '{segment.name}' "
                f"({segment.from_m} to {segment.to_m} m)",
                "correct from_m and to_m",
            )


def _geometry(specimen: "Specimen") -> Iterator[Inconsistency]:
    geometry = specimen.geometry
    if geometry.kind == "mesh_file":
        names = [part.name for part in specimen.parts]
        for name in geometry.regions:
            if name not in names:
                yield Inconsistency(
                    f"geometry.regions.{name}",
                    "no such segment or section with a length",
                    _suggest(name, names, "part"),
                )
        for key in geometry.chamber_surfaces:
            if key not in {str(chamber.index) for chamber in specimen.chambers}:
                yield Inconsistency(
                    f"geometry.chamber_surfaces.{key}", "no chamber of this index", "correct it"
                )
        return
    if specimen.parts and specimen.parts[0].from_m != 0.0:
        first = specimen.parts[0]
        yield Inconsistency(
            f"{_path(specimen, first.name)}.from_m",
            f"the body begins at {first.from_m} m",
            "let it begin at 0, the clamp",
        )
    if geometry.kind == "swept_lobes":
        bottom, top = geometry.station_heights_m[0], geometry.station_heights_m[-1]
        if bottom > 0.0 or top < specimen.length_m - HEIGHT_TOLERANCE_M:
            yield Inconsistency(
                "geometry.station_heights_m",
                f"stations span {bottom} to {top} m, the body 0 to {specimen.length_m} m",
                "give stations from the base to the tip",
            )
    wanted = {
        "swept_lobes": 3,
        "quadrant_cylinder": 4,
        "cylinder": max(2, specimen.chambers_per_segment),
        "block": 0,
    }[geometry.kind]
    for index, segment in enumerate(specimen.segments):
        azimuths = [chamber.azimuth_rad for chamber in specimen.chambers if chamber.segment == segment.name]
        if len(azimuths) != wanted:
            yield Inconsistency(
                f"segments[{index}]",
                f"{len(azimuths)} chamber{'s'[: len(azimuths) != 1]} where this {geometry.kind} has {wanted}",
                "correct [[chambers]]",
            )
        elif azimuths and not _even(azimuths):
            yield Inconsistency(
                "chambers",
                f"the azimuths in segment '{segment.name}' are not {360 / wanted:g} degrees apart",
                "space them evenly",
            )


def _even(azimuths: Sequence[float]) -> bool:
    """Return whether azimuths [rad], in any order, divide a full circle evenly."""
    spacing = math.tau / len(azimuths)
    places = [(azimuth - azimuths[0]) / spacing for azimuth in azimuths]
    close = all(abs(place - round(place)) * spacing <= AZIMUTH_TOLERANCE_RAD for place in places)
    return close and len({round(place) % len(places) for place in places}) == len(places)


def _references(specimen: "Specimen") -> Iterator[Inconsistency]:
    sections = [section.name for section in specimen.sections]
    parts = sections + [segment.name for segment in specimen.segments]
    named: list[tuple[str, str, list[str]]] = [
        *((f"markers[{i}].section", marker.section, sections) for i, marker in enumerate(specimen.markers)),
        *((f"calibration.modulus_scale.{key}", key, parts) for key in specimen.calibration.modulus_scale),
        *(
            (f"calibration.bends[{i}].section", entry.section, sections)
            for i, entry in enumerate(specimen.calibration.bends)
        ),
        *(
            (f"calibration.frames[{i}].section", entry.section, sections)
            for i, entry in enumerate(specimen.calibration.frames)
        ),
        *(
            (f"physics[{i}].where.section", entry.where.section, sections)
            for i, entry in enumerate(specimen.physics)
            if entry.where.section is not None
        ),
        *(
            (f"physics[{i}].where.segment", entry.where.segment, parts)
            for i, entry in enumerate(specimen.physics)
            if entry.where.segment is not None
        ),
    ]
    for path, name, names in named:
        if name not in names:
            yield Inconsistency(path, f"no part '{name}'", _suggest(name, names, "part"))
    count = len(specimen.chambers)
    for i, calibrated in enumerate(specimen.calibration.chambers):
        if calibrated.index >= count:
            yield Inconsistency(
                f"calibration.chambers[{i}].index", f"{calibrated.index} of {count} chambers", "correct it"
            )


def _rotations(specimen: "Specimen") -> Iterator[Inconsistency]:
    for index, section in enumerate(specimen.sections):
        norm = math.hypot(*section.frame_quaternion)
        if abs(norm - 1.0) > 1e-6:
            yield Inconsistency(
                f"sections[{index}].frame_quaternion", f"its norm is {norm:.6g}", "give a unit quaternion"
            )


def _suggest(name: str, names: list[str], kind: str) -> str:
    return suggest(name, names, f"give a known {kind}: {', '.join(names) or 'none is defined'}")

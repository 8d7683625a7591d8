"""Specimens from what a user measures with a ruler and a scale, and from the material's data sheet."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import tomli_w

from softarm.estimator.specimen.files import parse_specimen
from softarm.estimator.specimen.specimen import Specimen

POISSON_RATIO = 0.49
"""Silicone is nearly incompressible; bending hardly depends on how nearly (see the shipped specimens)."""
WOUND_N_M = 6500.0
"""Stiffness of a wall that is wound closely, that of the shipped specimen ``sopra``."""


@dataclass(frozen=True)
class SegmentMeasures:
    """One soft segment and the rigid section below it.

    Args:
        length_m: Length of the soft part [m].
        mass_kg: Its mass [kg].
        section_m: Length of the rigid section below it [m].
        section_kg: Mass of that section [kg].
    """

    length_m: float
    mass_kg: float
    section_m: float
    section_kg: float


@dataclass(frozen=True)
class LobeMeasures:
    """Three tapering lobes with a chamber in each, as SoPrA has them.

    Args:
        radii_m: Radius of a lobe at the base, and at the lower end of each segment [m].
        wall_m: Thickness of the walls around a chamber [m].
        floor_m: Thickness between a chamber and the core [m].
    """

    radii_m: tuple[float, ...]
    wall_m: float
    floor_m: float
    chambers: int = 3


@dataclass(frozen=True)
class CylinderMeasures:
    """A cylinder with equal chambers around a round core.

    Args:
        chambers: Number of chambers of a segment.
        outer_radius_m: Outer radius [m].
        wall_m: Thickness of the outer wall and of those between chambers [m].
        core_radius_m: Radius of the core [m].
    """

    chambers: int
    outer_radius_m: float
    wall_m: float
    core_radius_m: float


@dataclass(frozen=True)
class ArmMeasures:
    """A hanging arm of soft segments, each with chambers along it and a rigid section below.

    Args:
        name: Of the arm.
        base_m: Length of the rigid base [m].
        segments: The soft segments from the base to the tip.
        shape: Its cross-section.
        soft_young_pa: Young's modulus of the soft silicone [Pa].
        rigid_young_pa: Young's modulus of the rigid sections [Pa].
        density_kg_m3: Density of the silicone [kg/m3].
        pressure_limit_pa: Largest gauge pressure of a chamber [Pa].
        wound: Whether fibres around the chambers keep them from growing wider.
    """

    name: str
    base_m: float
    segments: tuple[SegmentMeasures, ...]
    shape: LobeMeasures | CylinderMeasures
    soft_young_pa: float
    rigid_young_pa: float
    density_kg_m3: float
    pressure_limit_pa: float
    wound: bool


def specimen_of_measures(measures: ArmMeasures) -> Specimen:
    """Build the specimen of an arm from its measures.

    Raises:
        InputError: The measures do not fit together, with the field that does not.
    """
    return parse_specimen(tomli_w.dumps(_table(measures)).encode(), measures.name)


def _table(measures: ArmMeasures) -> dict[str, object]:
    heights = _heights(measures)
    count = measures.shape.chambers
    segment_names, section_names = names_of(len(measures.segments))
    starts = heights[1:-1:2]
    ends = heights[2::2]
    sections = [_section(section_names[0], 0.0, measures.base_m, None)]
    segments, chambers = [], []
    for k, part in enumerate(measures.segments):
        begin, end = starts[k], ends[k]
        segments.append(
            {
                "name": segment_names[k],
                "from_m": begin,
                "to_m": end,
                "material": "soft",
                "mass_kg": part.mass_kg,
            }
        )
        sections.append(_section(section_names[k + 1], end, end + part.section_m, part.section_kg))
        chambers += [
            {
                "index": count * k + number,
                "segment": segment_names[k],
                "azimuth_rad": math.tau * number / count,
                "from_m": begin,
                "to_m": end,
                "pressure_limit_pa": measures.pressure_limit_pa,
            }
            for number in range(count)
        ]
    sections[-1]["frame_origin_m"] = [0.0, 0.0, heights[-1]]
    return {
        "schema": "softarm.specimen/1",
        "name": measures.name,
        "gravity_m_s2": [0.0, 0.0, 9.81],
        "geometry": _geometry(measures.shape, heights),
        "materials": {
            "soft": _material(measures.soft_young_pa, measures.density_kg_m3),
            "rigid": _material(measures.rigid_young_pa, measures.density_kg_m3),
        },
        "segments": segments,
        "sections": sections,
        "chambers": chambers,
        "fibres": {"kind": "membrane", "membrane_stiffness_n_m": WOUND_N_M}
        if measures.wound
        else {"kind": "none"},
    }


def _heights(measures: ArmMeasures) -> list[float]:
    """Return the heights of the ends of all parts [m]."""
    heights = [0.0, measures.base_m]
    for part in measures.segments:
        heights += [heights[-1] + part.length_m, heights[-1] + part.length_m + part.section_m]
    # Sums of decimals would write their rounding into the file.
    return [round(height, 9) for height in heights]


def _geometry(shape: LobeMeasures | CylinderMeasures, heights: list[float]) -> dict[str, object]:
    if isinstance(shape, CylinderMeasures):
        return {
            "kind": "cylinder",
            "outer_radius_m": shape.outer_radius_m,
            "wall_m": shape.wall_m,
            "core_radius_m": shape.core_radius_m,
        }
    return {
        "kind": "swept_lobes",
        "station_heights_m": heights,
        # Rigid parts do not taper: both ends of each have one radius.
        "lobe_radii_m": [radius for radius in shape.radii_m for _ in range(2)],
        "wall_m": shape.wall_m,
        "floor_m": shape.floor_m,
    }


def names_of(count: int) -> tuple[Sequence[str], Sequence[str]]:
    """Return the names of ``count`` segments and of their sections, from the base to the tip."""
    if count <= 2:
        return ("upper", "lower")[:count], ("base", "intermediate", "tip") if count == 2 else ("base", "tip")
    segments = tuple(f"segment_{k}" for k in range(1, count + 1))
    return segments, ("base", *(f"section_{k}" for k in range(1, count)), "tip")


def _section(name: str, begin: float, end: float, mass: float | None) -> dict[str, object]:
    origin = 0.0 if mass is None else 0.5 * (begin + end)
    table: dict[str, object] = {
        "name": name,
        "from_m": begin,
        "to_m": round(end, 9),
        "material": "rigid",
        "frame_origin_m": [0.0, 0.0, origin],
    }
    return table if mass is None else {**table, "mass_kg": mass}


def _material(young: float, density: float) -> dict[str, object]:
    return {
        "law": "neo_hookean",
        "shear_modulus_pa": young / (2.0 * (1.0 + POISSON_RATIO)),
        "poisson_ratio": POISSON_RATIO,
        "density_kg_m3": density,
    }

"""A fake arm of the shape that a specimen describes, with a material and tolerances of its own.

Shape, parts, masses, chambers and the direction of gravity are those of the specimen. What a calibration or a
diagnosis wrote into it is left out, so that a specimen and its calibrated copy name the same arm.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import SHIPPED, Section, Segment, Specimen
from softarm.fakes.plant.cross_section import CrossSection, sampled
from softarm.fakes.plant.instruments import InstrumentQuality
from softarm.fakes.plant.manoeuvres import ChamberLayout
from softarm.fakes.plant.mounts import HANGING
from softarm.fakes.plant.outline import Outline, outline_of
from softarm.fakes.plant.parameters import Actuation, ArmParameters, Mount, PlantFrame, PlantSegment, sopra
from softarm.fakes.plant.rotations import product, vector_quaternion
from softarm.fakes.plant.shape import has_shape_of_sopra
from softarm.fakes.plant.variants import Variant, variant

LINKS = 6
GRID = 120
"""Points along each side of the grid that samples a cross-section."""
WOUND_STIFFENING = 1.5
"""Modulus along a wound arm over Young's modulus of its silicone, that of the fake SoPrA: 390 to 264 kPa."""
WOUND_EXPONENT, BARE_EXPONENT = 3.0, 2.0
"""Of the stress: sides that cannot narrow, and those of incompressible rubber that can."""
FIBRE_DEPTH = 0.0009
DRIVEN = 0.75
LAG_S = 0.012
NEARLY_AN_AXIS = 0.985
"""Cosine of the angle up to which gravity counts as along an axis: what a calibration corrects it by."""


def arm_of(specimen: Specimen | None, seed: int) -> Variant:
    """Return the fake arm that plays a specimen: SoPrA where none is given or the specimen has its shape.

    Args:
        specimen: The arm.
        seed: Draws the tolerances of an arm that is not SoPrA.

    Raises:
        InputError: The arm has no rigid section before and after each segment, or its mesh cannot be read.
    """
    if specimen is None or has_shape_of_sopra(specimen):
        return Variant(sopra(), InstrumentQuality())
    return variant(seed, plain=drawing_of(specimen))


def name_of_drawing(specimen: str) -> str:
    """Return what a recording or a trial calls a specimen: its name, or the whole path of its file."""
    return specimen if specimen in SHIPPED else str(Path(specimen).resolve())


def layout_of(specimen: Specimen) -> ChamberLayout:
    """Return the properties of a specimen's arm for manoeuvres, which go up to 3/4 of its lowest limit."""
    return ChamberLayout(
        groups=tuple(
            tuple(c.index for c in specimen.chambers if c.segment == segment.name)
            for segment in specimen.segments
        ),
        azimuths=tuple(chamber.azimuth_rad for chamber in specimen.chambers),
        highest=DRIVEN * min(specimen.pressure_limits),
        sections=tuple(section.name for section in specimen.sections[1:]),
    )


def drawing_of(specimen: Specimen) -> ArmParameters:
    """Translate a specimen that has not the shape of SoPrA into the parameters of an arm without tolerances.

    Raises:
        InputError: As in ``arm_of``.
    """
    if not specimen.chambers:
        raise InputError(specimen.name, "has no chambers", "only arms with chambers can be simulated")
    sections = _below(specimen)
    outline, reach = outline_of(specimen)
    axis = np.linspace(-reach, reach, GRID) * 1.02
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    spacing = float(axis[1] - axis[0])
    segments = tuple(_segment(specimen, segment, outline, points, spacing) for segment in specimen.segments)
    count = len(specimen.chambers)
    solid = {s.name: _mass(specimen, s, outline, points, spacing) for s in sections[1:]}
    return ArmParameters(
        segments=segments,
        frames=tuple(PlantFrame(s.name, s.frame_origin_m, s.frame_quaternion) for s in sections),
        rigid_masses=tuple(solid.values()),
        rigid_lengths=tuple(section.to_m - section.from_m for section in sections[1:]),
        actuation=Actuation(
            gains=(1.0,) * count,
            crosstalk=((0.0,) * count,) * count,
            lags=(LAG_S,) * count,
            leak_rates=(0.0,) * count,
        ),
        mount=_mount(specimen),
    )


def _below(specimen: Specimen) -> list[Section]:
    """Return the section at the base and the one below each segment.

    Raises:
        InputError: There are others, or one is missing.
    """
    chosen = [specimen.section_above(specimen.segments[0].from_m)]
    chosen += [specimen.section_below(segment.to_m) for segment in specimen.segments]
    if chosen != [section.name for section in specimen.sections]:
        raise InputError(
            f"{specimen.name}: sections",
            "are not one at the base and one below each segment",
            "only arms with this order of sections can be simulated",
        )
    return list(specimen.sections)


def _segment(
    specimen: Specimen, segment: Segment, outline: Outline, points: Floats, spacing: float
) -> PlantSegment:
    length = segment.to_m - segment.from_m
    chambers = tuple(c for c in specimen.chambers if c.segment == segment.name)
    sections = []
    for number in range(LINKS):
        height = segment.from_m + (number + 0.5) / LINKS * length
        there = tuple(c for c in chambers if c.from_m < height < c.to_m)
        if there != chambers:
            raise InputError(
                f"{specimen.name}: segments.{segment.name}",
                "has a chamber that does not run along it",
                "let from_m and to_m of the chambers be those of the segment",
            )
        sections.append(_lumped(specimen, outline(height, points, there), points, spacing))
    material = specimen.materials[segment.material]
    wound = specimen.fibres.kind != "none"
    area = float(np.mean([section.areas.sum() for section in sections]))
    radii = sections[0].radius, sections[-1].radius
    return PlantSegment(
        segment.name,
        segment.from_m,
        length,
        radii,
        segment.mass_kg or area * length * material.density_kg_m3,
        links=LINKS,
        modulus=material.young * (WOUND_STIFFENING if wound else 1.0),
        exponent=WOUND_EXPONENT if wound else BARE_EXPONENT,
        chambers=tuple(chamber.index for chamber in chambers),
        cross_sections=tuple(sections),
    )


def _lumped(
    specimen: Specimen,
    masks: tuple[NDArray[np.bool_], list[NDArray[np.bool_]]],
    points: Floats,
    spacing: float,
) -> CrossSection:
    """Lump a cross-section; the pressure acts on all that the winding encloses."""
    inside, hollows = masks
    solid = inside & ~np.logical_or.reduce([*hollows, np.zeros_like(inside)])
    section = sampled(points, spacing, solid, hollows)
    if specimen.fibres.kind == "none":
        return section
    rims = np.sqrt(section.chamber_areas / np.pi)
    grown = section.chamber_areas * (1.0 + FIBRE_DEPTH / rims) ** 2
    return replace(section, chamber_areas=grown)


def _mass(specimen: Specimen, section: Section, outline: Outline, points: Floats, spacing: float) -> float:
    """Return the weighed or computed mass of a rigid section [kg]; that of a face is 0."""
    if section.mass_kg is not None or section.material is None:
        return section.mass_kg or 0.0
    inside, _ = outline(0.5 * (section.from_m + section.to_m), points, ())
    volume = float(inside.sum()) * spacing**2 * (section.to_m - section.from_m)
    return volume * specimen.materials[section.material].density_kg_m3


def _mount(specimen: Specimen) -> Mount:
    """Rotate the base so that gravity acts as the specimen states, along an axis where it nearly does."""
    down = np.array(specimen.gravity_m_s2) / np.linalg.norm(specimen.gravity_m_s2)
    nearest = np.eye(3)[np.argmax(np.abs(down))] * np.sign(down[np.argmax(np.abs(down))])
    if down @ nearest > NEARLY_AN_AXIS:
        down = nearest
    axis = np.cross(down, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    axis = axis / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])
    w, x, y, z = product(HANGING, vector_quaternion(float(np.arctan2(sine, down[2])) * axis))
    return Mount(quaternion=(float(w), float(x), float(y), float(z)))

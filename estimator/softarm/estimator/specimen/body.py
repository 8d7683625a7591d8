"""The parts of the arm along its axis: soft segments, rigid sections, chambers, fibres, markers."""

from typing import Annotated, Literal

from pydantic import Field

from softarm.estimator.specimen.entry import (
    Angle,
    Entry,
    Finite,
    Name,
    NotNegative,
    Positive,
    Quaternion,
    Vector,
)

Index = Annotated[int, Field(ge=0)]

AZIMUTH_TOLERANCE_RAD = 1e-3
"""How far chambers may be off even spacing: more than a file is rounded, less than an arm is cast."""


class Segment(Entry):
    """A soft length of the arm."""

    name: Name
    """Its name: ``upper`` or ``lower`` on a two-segment arm."""
    from_m: Finite
    """Height at which it begins."""
    to_m: Finite
    """Height at which it ends."""
    material: Name
    """Key of its material in ``[materials]``."""
    mass_kg: Positive | None = None
    """Weighed mass with all that is cast in; left out, volume times density."""


class Section(Entry):
    """A rigid length of the arm, or a plane of it, that carries a frame."""

    name: Name
    """Its name: ``base``, ``intermediate`` or ``tip``."""
    from_m: Finite
    """Height at which it begins."""
    to_m: Finite
    """Height at which it ends; equal to ``from_m`` for a face that carries a frame."""
    material: Name | None = None
    """Key of its material in ``[materials]``; left out for a face."""
    mass_kg: Positive | None = None
    """Weighed mass with all that is fixed to it; left out, volume times density."""
    frame_origin_m: Vector
    """Origin of its frame at rest, in the base frame."""
    frame_quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rest orientation (w, x, y, z) of its frame: rotates section axes to base axes."""


class Chamber(Entry):
    """A closed pressure chamber."""

    index: Index
    """Its number, from 0 without gaps."""
    segment: Name
    """Segment that it lies in."""
    azimuth_rad: Angle
    """Direction of its centre about z, from the base frame's x axis towards y; except in a mesh file, the
    chambers of a segment are evenly spaced (to 0.001 rad) and lie at the same azimuths in every segment."""
    from_m: Finite
    """Height of its closed upper end."""
    to_m: Finite
    """Height of its closed lower end."""
    pressure_limit_pa: Positive
    """Largest safe gauge pressure."""


class Fibres(Entry):
    """Inextensible thread wound around each chamber, which keeps it from growing sideways."""

    kind: Literal["membrane", "springs", "none"]
    """``membrane``: a sheet on the chamber's wall, stiff around its circumference; ``springs``: rings of bars
    mapped into the elements, which do not converge with the mesh; ``none``."""
    membrane_stiffness_n_m: NotNegative = 0.0
    """Circumferential force per length of chamber and unit strain."""
    spring_stiffness_n_m: NotNegative = 0.0
    """Stiffness of each bar."""
    rings_per_chamber: Annotated[int, Field(ge=1)] = 20
    """Rings of bars along each chamber."""
    bars_per_ring: Annotated[int, Field(ge=3)] = 12
    """Bars in each ring."""


class Clamp(Entry):
    """Clamp of the arm."""

    up_to_m: Finite = 0.0
    """Nodes at this height or below are held."""


class Marker(Entry):
    """A reflective marker of the motion capture, fixed to a section."""

    name: Name
    """Its name in the recordings' columns."""
    section: Name
    """Section that carries it."""
    offset_m: Vector
    """Its place in the section's frame."""


class SensorNoise(Entry):
    """Standard deviation of one reading of each kind of sensor."""

    marker_m: Positive = 2.0e-4
    """Each coordinate of a marker."""
    position_m: Positive = 2.0e-4
    """Each coordinate of a section frame's origin."""
    orientation_rad: Positive = 1.75e-3
    """Each axis of a section's orientation (0.1 degrees)."""
    bend_rad: Positive = 1.75e-3
    """Each axis of a two-axis bend (0.1 degrees)."""
    pressure_pa: Positive = 200.0
    """A measured chamber pressure."""
    nominal_pressure_relative: NotNegative = 0.05
    """A commanded or nominal pressure that nobody measured, relative to its value."""
    gauge_n: Positive = 3.0e-3
    """A force gauge that shows whole grams."""

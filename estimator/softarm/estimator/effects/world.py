"""The arm as effects see it: names, places of chambers, stiffness of segments."""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.effects.surface import Surface
from softarm.estimator.errors import InputError
from softarm.estimator.geometry.outer import outer_radii
from softarm.estimator.sensing import ActuationMap
from softarm.estimator.simulation import Segments
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import Place


@dataclass(frozen=True)
class World:
    """What effects may refer to.

    Args:
        segments: Names of the segments.
        sections: Names of the sections.
        sensors: Names of the sensors.
        chamber_segment: Segment of each chamber, shape (chambers,).
        chamber_azimuth: Direction of each chamber about z [rad], shape (chambers,).
        pressure_limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        stiffness: Stiffness of each segment against its couples: bending twice, torsion [N m], axial force
            [N/m]; shape (segments, 4), or as matrices in every pose, (samples, segments, 4, 4).
        masses: Masses of the sections, at their origins [kg], 0 where unknown; shape (sections,).
        segment_masses: Masses of the segments, along their axes [kg], 0 where unknown; shape (segments,).
        origins: Origins of the sections at rest [m], shape (sections, 3).
        surface: The surface along the arm.
        pressures_measured: Whether pressures are those of sensors at the chambers, not set-points.
        actuation: From the pressures in the chambers to those that drive the model; ``None`` where they are
            the same.
    """

    segments: tuple[str, ...]
    sections: tuple[str, ...]
    sensors: tuple[str, ...]
    chamber_segment: tuple[int, ...]
    chamber_azimuth: Floats
    pressure_limits: Floats
    stiffness: Floats
    masses: Floats
    segment_masses: Floats
    origins: Floats
    surface: Surface
    pressures_measured: bool = False
    actuation: ActuationMap | None = None

    @classmethod
    def of(
        cls,
        specimen: Specimen,
        segments: Segments,
        sections: tuple[str, ...],
        stiffness: Floats,
        sensors: tuple[str, ...] = (),
        pressures_measured: bool = False,
        actuation: ActuationMap | None = None,
    ) -> "World":
        """Describe a specimen whose segments' stiffness is known, as of ``SimulatedArm.stiffness``."""
        return cls(
            segments.names,
            sections,
            sensors,
            tuple(segments.names.index(chamber.segment) for chamber in specimen.chambers),
            np.array([chamber.azimuth_rad for chamber in specimen.chambers]),
            np.array(specimen.pressure_limits),
            stiffness,
            np.array([specimen.section(name).mass_kg or 0.0 for name in sections]),
            np.array([specimen.segment(name).mass_kg or 0.0 for name in segments.names]),
            segments.rest.positions,
            Surface.of(segments, specimen.sections[-1].to_m, partial(outer_radii, specimen)),
            pressures_measured,
            actuation,
        )

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return len(self.chamber_segment)

    @property
    def radii(self) -> Floats:
        """Radius of a thin ring that bends and stretches as each segment does [m], shape (segments,)."""
        stiffness = self.stiffness
        if stiffness.ndim == 4:
            stiffness = np.median(np.diagonal(stiffness, axis1=2, axis2=3), axis=0)
        radii: Floats = np.sqrt(2.0 * stiffness[:, :2].mean(axis=1) / stiffness[:, 3])
        return radii

    def first_moment(self, positions: Floats, rotations: Floats) -> Floats:
        """Return the sum of all masses times their places [kg m], shape (samples, 3).

        Args:
            positions: Origins of the sections [m], shape (samples, sections, 3).
            rotations: Rotations of the sections, shape (samples, sections, 3, 3).
        """
        return self.masses @ positions + self._segments_weighed.points(positions, rotations)[:, 0]

    @cached_property
    def _segments_weighed(self) -> Surface:
        """The points of the segments' axes, summed with masses in proportion to their cross-sections."""
        return self.surface.summed(self.segment_masses)

    def couples(self, strains: Floats) -> Floats:
        """Return the couples that strain the segments by so much, shape (samples, segments, 4)."""
        if self.stiffness.ndim == 4:
            couples: Floats = np.einsum("tgij,tgj->tgi", self.stiffness, strains)
            return couples
        return strains * self.stiffness

    def strains(self, couples: Floats) -> Floats:
        """Return the strains that couples alone would make, shape (samples, segments, 4)."""
        if self.stiffness.ndim == 4:
            strained: Floats = np.asarray(np.linalg.solve(self.stiffness, couples[..., None])[..., 0])
            return strained
        return couples / self.stiffness


@dataclass(frozen=True)
class Spot:
    """A place, resolved in a world.

    Raises:
        InputError: If the place names something that the arm does not have.
    """

    world: World
    place: Place

    def __post_init__(self) -> None:
        world = self.world
        known: tuple[tuple[str, object, tuple[object, ...]], ...] = (
            ("segment", self.place.segment, world.segments),
            ("section", self.place.section, world.sections),
            ("chamber", self.place.chamber, tuple(range(world.chambers))),
            ("sensor", self.place.sensor, world.sensors),
        )
        for kind, name, names in known:
            if name is not None and name not in names:
                listed = ", ".join(map(str, names)) or "none"
                raise InputError(f"physics.where.{kind}", f"no {kind} {name!r}", f"choose from: {listed}")

    @property
    def segments(self) -> Flags:
        """Segments it acts on, all where the place names none, shape (segments,)."""
        named = self.place.segment
        return np.array([named in (None, name) for name in self.world.segments])

    @property
    def chambers(self) -> Flags:
        """Chambers it acts on: the named one, those of the named segment, or all; shape (chambers,)."""
        if self.place.chamber is not None:
            return np.array([index == self.place.chamber for index in range(self.world.chambers)])
        chosen: Flags = self.segments[list(self.world.chamber_segment)]
        return chosen

    @property
    def section(self) -> int:
        """Section it acts on, the last where the place names none."""
        named = self.place.section
        return len(self.world.sections) - 1 if named is None else self.world.sections.index(named)


AROUND = tuple(np.radians(np.arange(-180.0, 180.0, 45.0)).tolist())
"""Directions in the cross-section in which what acts on one side is tried [rad]."""


def everywhere(world: World) -> tuple[Place, ...]:  # noqa: ARG001
    """The arm as a whole."""
    return (Place(),)


def whole_and_segments(world: World) -> tuple[Place, ...]:
    """The arm as a whole, and each segment alone; where there is one segment only, that one."""
    return segments(world) if len(world.segments) == 1 else (Place(), *segments(world))


def segments(world: World) -> tuple[Place, ...]:
    """Each segment."""
    return tuple(Place(segment=name) for name in world.segments)


def chambers(world: World) -> tuple[Place, ...]:
    """Each chamber."""
    return tuple(Place(chamber=index) for index in range(world.chambers))


def whole_and_chambers(world: World) -> tuple[Place, ...]:
    """All chambers together, and each alone."""
    return (Place(), *chambers(world))


def whole_segments_and_chambers(world: World) -> tuple[Place, ...]:
    """The places of ``whole_and_segments``, and each chamber alone."""
    return (*whole_and_segments(world), *chambers(world))


def moving_sections(world: World) -> tuple[Place, ...]:
    """Each section below a segment."""
    return tuple(Place(section=name) for name in world.sections if name != "base")


def sensors(world: World) -> tuple[Place, ...]:
    """Each sensor."""
    return tuple(Place(sensor=name) for name in world.sensors)

"""The arm as a chain of links between stations on its axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError, require_known
from softarm.estimator.model import Frames, Load
from softarm.estimator.rod.arrays import Actions
from softarm.estimator.rod.statics import place


@dataclass(frozen=True)
class Chain:
    """Rest geometry, chambers and mass of the links.

    Station 0 is the clamp, link i joins stations i and i + 1; at rest all axes are those of the base frame.

    Args:
        heights: Rest heights of the stations [m], rising, shape (links + 1,).
        sections: Names of the sections whose frames are given.
        section_station: Station that each section's frame is fixed to, shape (sections,).
        section_offset: Origin of each section's frame in its station's [m], shape (sections, 3).
        section_rotation: Rotation of each section's frame in its station's, shape (sections, 3, 3).
        regions: Name of the region whose stiffness each link has, by link.
        chambers: Chambers around each link, -1 where there are fewer, shape (links, width).
        chamber_count: Number of chambers of the arm.
        mass: Mass of each link [kg], shape (links,).
        mass_centre: Share of the link at which its centre of mass lies, shape (links,).
        mass_weights: Weights of the link's own weight in its wrench, as ``Actions.beta``, shape (links, 5).
    """

    heights: Floats
    sections: tuple[str, ...]
    section_station: Indices
    section_offset: Floats
    section_rotation: Floats
    regions: tuple[str, ...]
    chambers: Indices
    chamber_count: int
    mass: Floats
    mass_centre: Floats
    mass_weights: Floats

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.heights) - 1

    @cached_property
    def lengths(self) -> Floats:
        """Rest lengths of the links [m], shape (links,)."""
        return np.diff(self.heights)

    def station_frames(self, strain: Floats) -> Frames:
        """Compute the frames of all stations, the clamp first, for the links' strains, shape (links, 6)."""
        rotations, positions = np.empty((self.links + 1, 3, 3)), np.empty((self.links + 1, 3))
        rotations[0], positions[0] = np.eye(3), (0.0, 0.0, self.heights[0])
        strain, middles = np.ascontiguousarray(strain, dtype=np.float64), np.empty((self.links, 3, 3))
        place(strain, self.lengths, rotations, positions, middles)
        return Frames(positions, rotations)

    def place(self, load: Load) -> tuple[int, float, Floats]:
        """Find link, share and offset of a load's place; link -1 where it acts on the clamp.

        Raises:
            InputError: If it names an unknown section, a height outside the arm, or no place.
        """
        where = f"load {load.name!r}"
        if load.section is not None:
            require_known(where, "section", load.section, self.sections)
            index = self.sections.index(load.section)
            return int(self.section_station[index]) - 1, 1.0, self.section_offset[index]
        if load.height is None:
            raise InputError(where, "neither a section nor a height", "name one")
        low, high = float(self.heights[0]), float(self.heights[-1])
        # The last station lies inside the last rigid section, all of which may be pushed.
        reach = high + max(0.0, *(float(offset[2]) for offset in self.section_offset))
        if not low <= load.height <= reach + 1e-9:
            what = f"height {load.height:g} m is outside the arm ({low:g} to {reach:g} m)"
            raise InputError(where, what, "give a height on the arm")
        if load.height >= high:
            return self.links - 1, 1.0, np.array([0.0, 0.0, load.height - high])
        link = int(np.searchsorted(self.heights, load.height, side="right")) - 1
        share = (load.height - self.heights[link]) / self.lengths[link]
        return link, float(share), np.zeros(3)

    def actions(self, loads: Sequence[Load]) -> Actions:
        """Compute the places of the links' weights, then of the loads."""
        placed = [self.place(load) for load in loads]
        # A load on the clamp gets share 0 of link 0, with which it counts in no wrench.
        link = np.array([*range(self.links), *(max(place[0], 0) for place in placed)], dtype=np.int64)
        share = np.array([*self.mass_centre, *(0.0 if place[0] < 0 else place[1] for place in placed)])
        offset = np.array([*np.zeros((self.links, 3)), *(place[2] for place in placed)])
        points = point_weights(share[self.links :], self.lengths[link[self.links :]])
        return Actions(link, share, offset, np.concatenate([self.mass_weights, points]))


def point_weights(share: Floats, length: Floats) -> Floats:
    """Compute the weights of point actions in the wrench of their own link.

    The moment of a lateral force F at a share s of a link of length l, F l (s - z) for z < s, has over
    it the mean F l s^2 / 2 and, by least squares, the slope -F l (3 s^2 - 2 s^3); a couple C acts for z < s,
    with mean s C and slope 6 s (s - 1) C. A link's strain only sees these two where it bends evenly.

    Args:
        share: s of each action, shape (actions,).
        length: l of its link [m], shape (actions,).

    Returns:
        Weights of lateral force, axial force, moment of the force [m], couple and shear per couple [1/m],
        shape (actions, 5).
    """
    s = np.asarray(share, dtype=np.float64)
    shear = 6.0 * s * (1.0 - s) / np.where(length > 0, length, 1.0)
    return np.stack([3 * s**2 - 2 * s**3, s, 0.5 * s**2 * length, s, shear], axis=-1).reshape(-1, 5)

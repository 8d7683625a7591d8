"""The shapes that a body can have; lengths in metres, z from the base to the tip."""

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from softarm.estimator.specimen.entry import Entry, Name, Positive, Quaternion, Vector

ROOM = "give a core that leaves room for the chambers"


def _misfit(what: str, cure: str) -> PydanticCustomError:
    return PydanticCustomError("misfit", "{what}", {"what": what, "cure": cure})


class SweptLobes(Entry):
    """A tapering sweep of an equilateral triangle with a half disc on each side.

    The triangle's sides are two lobe radii long. Each half disc holds one half-disc chamber per soft
    segment, ``wall_m`` inside the lobe's arc and ``floor_m`` above the triangle's side. The lobes point to
    the azimuths of the chambers.
    """

    kind: Literal["swept_lobes"]
    """Always ``swept_lobes``."""
    station_heights_m: Annotated[tuple[float, ...], Field(min_length=2)]
    """Heights at which the lobe radius is given, rising; linear in between."""
    lobe_radii_m: Annotated[tuple[Positive, ...], Field(min_length=2)]
    """Lobe radius at each station."""
    wall_m: Positive
    """Thickness of the chamber's outer wall."""
    floor_m: Positive
    """Distance from the triangle's side to the flat side of the chamber."""

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if len(self.lobe_radii_m) != len(self.station_heights_m):
            what = f"{len(self.lobe_radii_m)} lobe radii for {len(self.station_heights_m)} station heights"
            raise _misfit(what, "give one lobe radius per station height")
        if any(above >= below for above, below in pairwise(self.station_heights_m)):
            raise _misfit("station heights do not rise", "sort the stations from base to tip")
        least = 2.0 * self.wall_m + self.floor_m
        if min(self.lobe_radii_m) <= least:
            smallest = f"lobe radius {min(self.lobe_radii_m):g} m"
            what = f"{smallest} leaves no room for a chamber (at least {least:g} m)"
            raise _misfit(what, "give thinner walls or wider lobes")
        return self


class QuadrantCylinder(Entry):
    """A cylinder with four chambers in its quadrants around a rounded square core.

    Each chamber is bounded by the outer wall, by the two walls that divide it from its neighbours and by the
    core |x| + |y| <= ``core_m`` (axes along the dividing walls).
    """

    kind: Literal["quadrant_cylinder"]
    """Always ``quadrant_cylinder``."""
    outer_radius_m: Positive
    """Outer radius of the cylinder."""
    wall_m: Positive
    """Thickness of the outer and of the dividing walls."""
    core_m: Positive
    """Half diagonal of the square core."""

    @model_validator(mode="after")
    def _room(self) -> Self:
        inside = self.outer_radius_m - self.wall_m
        if not self.wall_m < self.core_m < inside:
            between = f"{self.wall_m:g} m (the wall) and {inside:g} m (inner radius)"
            raise _misfit(f"core {self.core_m:g} m is not between {between}", ROOM)
        return self


class Cylinder(Entry):
    """A cylinder with two or more equal chambers around a round core.

    The number of chambers is that of each segment in ``[[chambers]]``. Each chamber is bounded by the outer
    wall, by the two walls that divide it from its neighbours and by the core.
    """

    kind: Literal["cylinder"]
    """Always ``cylinder``."""
    outer_radius_m: Positive
    """Outer radius of the cylinder."""
    wall_m: Positive
    """Thickness of the outer and of the dividing walls."""
    core_radius_m: Positive
    """Radius of the core."""

    @model_validator(mode="after")
    def _room(self) -> Self:
        inside = self.outer_radius_m - self.wall_m
        if not 0.5 * self.wall_m < self.core_radius_m < inside:
            between = f"{0.5 * self.wall_m:g} m (half the wall) and {inside:g} m (inner radius)"
            raise _misfit(f"core radius {self.core_radius_m:g} m is not between {between}", ROOM)
        return self


class Block(Entry):
    """A solid cuboid about the z axis, without chambers."""

    kind: Literal["block"]
    """Always ``block``."""
    width_x_m: Positive
    """Extent along x."""
    width_y_m: Positive
    """Extent along y."""


class MeshFile(Entry):
    """A mesh from a file that meshio reads (``.msh``, ``.vtk``, ``.vtu``, ``.inp``, ...).

    Linear or quadratic tetrahedra or hexahedra. Names of groups are physical groups (gmsh), cell or point
    sets, or ``array=value`` for an integer in a data array of the cells or points, such as
    ``medit:ref=3``.
    """

    kind: Literal["mesh_file"]
    """Always ``mesh_file``."""
    path: Annotated[str, Field(min_length=1)]
    """The mesh, relative to the specimen file."""
    metres_per_unit: Positive = 1.0
    """Length of one unit of the mesh's coordinates."""
    origin_m: Vector = (0.0, 0.0, 0.0)
    """Where the mesh's origin lies in the base frame."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation (w, x, y, z) from the mesh's axes to those of the base frame."""
    regions: dict[Name, str] = Field(default_factory=dict)
    """Group of each segment and section; left out, the elements' heights decide."""
    chamber_surfaces: dict[str, str] = Field(default_factory=dict)
    """Group of facets of each chamber's wall, by the chamber's index; left out, the closed inner surfaces are
    assigned to the chambers by height and azimuth."""
    clamp: str | None = None
    """Group of the held nodes; left out, the heights of ``[clamp]`` decide."""


Geometry = Annotated[SweptLobes | QuadrantCylinder | Cylinder | Block | MeshFile, Field(discriminator="kind")]

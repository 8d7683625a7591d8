"""The whole description of one robot."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, PrivateAttr, model_validator

from softarm.estimator.specimen.body import Chamber, Clamp, Fibres, Marker, Section, Segment, SensorNoise
from softarm.estimator.specimen.calibration import Calibration
from softarm.estimator.specimen.checks import raise_inconsistencies
from softarm.estimator.specimen.entry import Entry, Name, Vector
from softarm.estimator.specimen.geometry import Geometry
from softarm.estimator.specimen.material import Material
from softarm.estimator.specimen.physics import Physics

TOUCHING_M = 1e-6  # parts whose faces are nearer touch


class Specimen(Entry):
    """One robot: its shape, materials, chambers and sensors, and the results of calibration and diagnosis.

    The base frame has its origin at the clamp and z from the base to the tip along the axis at rest.
    """

    schema_: Annotated[Literal["softarm.specimen/1"], Field(alias="schema")] = "softarm.specimen/1"
    """Version of this format."""
    name: Name
    """Name of the specimen."""
    notes: str = ""
    """Where the figures come from."""
    gravity_m_s2: Vector = (0.0, 0.0, 9.81)
    """Gravitational acceleration in the base frame; (0, 0, 9.81) hangs from the base."""
    geometry: Geometry
    """Shape of the body; ``kind`` chooses one of the tables below."""
    materials: Annotated[dict[Name, Material], Field(min_length=1)]
    """Materials by name; ``law`` chooses one of the tables below."""
    segments: Annotated[tuple[Segment, ...], Field(min_length=1)]
    """Soft segments, from base to tip."""
    sections: Annotated[tuple[Section, ...], Field(min_length=2)]
    """Rigid sections, from base to tip."""
    chambers: tuple[Chamber, ...] = ()
    """Pressure chambers, in the order of their index."""
    fibres: Fibres = Fibres(kind="none")
    """Winding of the chambers."""
    clamp: Clamp = Clamp()
    """Clamp of the arm."""
    markers: tuple[Marker, ...] = ()
    """Markers of the motion capture."""
    noise: SensorNoise = SensorNoise()
    """Noise of the sensors."""
    calibration: Calibration = Calibration()
    """Results of calibration."""
    physics: tuple[Physics, ...] = ()
    """Physical effects accepted into the model."""

    _folder: Path = PrivateAttr(default_factory=Path)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        raise_inconsistencies(self)
        return self

    @property
    def folder(self) -> Path:
        """Folder of the file it was read from; a mesh file's path starts here."""
        return self._folder

    def placed_in(self, folder: Path) -> "Specimen":
        """Return the same specimen as if read from a folder."""
        placed = self.model_copy()
        # Private attributes are no part of the file and may be set on a frozen model.
        placed._folder = folder
        return placed

    @property
    def pressure_limits(self) -> tuple[float, ...]:
        """Largest safe gauge pressure of each chamber [Pa]."""
        return tuple(chamber.pressure_limit_pa for chamber in self.chambers)

    @property
    def chambers_per_segment(self) -> int:
        """Number of chambers in the first segment."""
        return sum(chamber.segment == self.segments[0].name for chamber in self.chambers)

    @property
    def length_m(self) -> float:
        """Height of the tip end of the last part [m]."""
        return max(part.to_m for part in self.named_parts)

    @property
    def named_parts(self) -> tuple[Segment | Section, ...]:
        """Segments, then sections, faces included."""
        return tuple[Segment | Section, ...]([*self.segments, *self.sections])

    @property
    def parts(self) -> tuple[Segment | Section, ...]:
        """Segments and sections that have a body, from base to tip."""
        solid = [part for part in self.named_parts if part.to_m > part.from_m]
        return tuple(sorted(solid, key=lambda part: part.from_m))

    def segment(self, name: str) -> Segment:
        """Return a segment by name."""
        return next(part for part in self.segments if part.name == name)

    def section(self, name: str) -> Section:
        """Return a section by name."""
        return next(part for part in self.sections if part.name == name)

    def section_above(self, height_m: float, among: Collection[str] = ()) -> str | None:
        """Return the nearest section that ends at a height or nearer to the base; ``None`` where none does.

        Args:
            height_m: Rest distance from the base [m].
            among: Names of sections to choose from; all of them when empty.
        """
        before = [s for s in self._chosen(among) if s.to_m <= height_m + TOUCHING_M]
        return max(before, key=lambda section: section.to_m).name if before else None

    def section_below(self, height_m: float, among: Collection[str] = ()) -> str | None:
        """Return the nearest section that begins at a height or nearer to the tip; see ``section_above``."""
        after = [s for s in self._chosen(among) if s.from_m >= height_m - TOUCHING_M]
        return min(after, key=lambda section: section.from_m).name if after else None

    def _chosen(self, among: Collection[str]) -> list[Section]:
        return [section for section in self.sections if not among or section.name in among]

"""How finely a parametric body is meshed."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Resolution:
    """Divisions of a swept body.

    Args:
        around: Elements along each quarter of a chamber's arc, and along what meets it.
        through: Elements through a wall.
        layers: Layers of elements along each soft segment.
        section_layers: Layers of elements along each rigid section.
        end_layer: Thickness of a segment's first and last layer over that of its inner layers.
        refinement: Parts into which every element is then divided, in each direction.
    """

    around: int = 1
    through: int = 1
    layers: int = 1
    section_layers: int = 1
    end_layer: float = 1.0
    refinement: int = 1

    @property
    def arc_divisions(self) -> int:
        """Elements along each quarter of a chamber's arc."""
        return self.around * self.refinement

    @property
    def wall_divisions(self) -> int:
        """Elements through a wall."""
        return self.through * self.refinement


DEFAULTS = {
    "swept_lobes": Resolution(layers=1),
    "quadrant_cylinder": Resolution(layers=3),
    "cylinder": Resolution(layers=3),
    "block": Resolution(layers=6),
    "mesh_file": Resolution(),
}
"""Resolution of each kind of body, chosen so that refining it changes little (``softarm bench mesh``)."""

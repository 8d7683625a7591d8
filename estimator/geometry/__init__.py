"""From the description of a specimen to the mesh of its body."""

from estimator.geometry.build import build_mesh
from estimator.geometry.resolution import DEFAULTS, Resolution

__all__ = ["DEFAULTS", "Resolution", "build_mesh"]

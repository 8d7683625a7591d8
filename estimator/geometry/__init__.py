"""From the description of a specimen to the mesh of its body."""

from estimator.geometry.build import build_mesh
from estimator.geometry.resolution import DEFAULT_RESOLUTION, Resolution

__all__ = ["DEFAULT_RESOLUTION", "Resolution", "build_mesh"]

"""From the description of a specimen to the mesh of its body."""

from softarm.estimator.geometry.build import build_mesh
from softarm.estimator.geometry.resolution import DEFAULTS, Resolution

__all__ = ["DEFAULTS", "Resolution", "build_mesh"]

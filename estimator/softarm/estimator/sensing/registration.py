"""Where the laboratory's frame lies in the arm's base frame."""

from dataclasses import dataclass, field

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.rotations import exp, nearest_rotation, skew


@dataclass(frozen=True, eq=False)
class Registration:
    """The rigid map from the laboratory to the base frame: base = rotation lab + translation.

    Args:
        rotation: Shape (3, 3).
        translation: [m], shape (3,).
        covariance: Covariance of its error as a twist in the base frame, base' = exp(w) base + v,
            v [m] before w [rad], shape (6, 6).
    """

    rotation: Floats = field(default_factory=lambda: np.eye(3))
    translation: Floats = field(default_factory=lambda: np.zeros(3))
    covariance: Floats = field(default_factory=lambda: np.zeros((6, 6)))

    def to_base(self, points: Floats) -> Floats:
        """Map laboratory points into the base frame, shape (..., 3)."""
        moved: Floats = points @ self.rotation.T + self.translation
        return moved

    def moved(self, twist: Floats) -> "Registration":
        """Move what it maps to by a twist (v [m], w [rad]) of shape (6,): base' = exp(w) base + v."""
        rotation = exp(twist[3:])
        return Registration(
            rotation @ self.rotation, rotation @ self.translation + twist[:3], self.covariance
        )

    def to_laboratory(self, points: Floats) -> Floats:
        """Map base points into the laboratory frame, shape (..., 3)."""
        moved: Floats = (points - self.translation) @ self.rotation
        return moved


def register(
    base_points: Floats, laboratory_points: Floats, sigma: float, source: str = "base markers"
) -> Registration:
    """Find the laboratory in the base frame from markers on the base (Kabsch 1976).

    The covariance is that of the least-squares fit, (sum J^T J / sigma^2)^-1 with J = [1, -[x]] at each
    marker x; three markers on a line leave it infinite about that line and are refused.

    Args:
        base_points: Known positions of the markers in the base frame [m], shape (markers, 3).
        laboratory_points: Measured positions [m], shape (markers, 3), or (samples, markers, 3) of which the
            mean is taken without lost readings (NaN).
        sigma: Standard deviation of one coordinate of ``laboratory_points`` (of their mean) [m].
        source: What they were recorded in, for messages.

    Raises:
        InputError: With fewer than three markers, or with markers on one line.
    """
    measured = np.asarray(laboratory_points, dtype=np.float64)
    if measured.ndim == 3:
        counts = np.isfinite(measured).sum(axis=0)
        measured = np.where(counts > 0, np.nansum(measured, axis=0) / np.maximum(counts, 1), np.nan)
    valid = np.isfinite(measured).all(axis=-1)
    expected, measured = base_points[valid], measured[valid]
    if len(expected) < 3:
        what = f"{len(expected)} of {len(base_points)} are seen, at least three are needed"
        raise InputError(source, what, "record three of them, named as in the specimen")
    centre, measured_centre = expected.mean(axis=0), measured.mean(axis=0)
    spread = np.linalg.svd(expected - centre, compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise InputError(source, "they lie on one line", "move one of them off it")
    # The rotation maps the second factor, in the laboratory, to the first, in the base frame.
    rotation = nearest_rotation((expected - centre).T @ (measured - measured_centre))
    jacobians = np.concatenate([np.tile(np.eye(3), (len(expected), 1, 1)), -skew(expected)], axis=-1)
    information = np.einsum("nij,nik->jk", jacobians, jacobians) / sigma**2
    return Registration(rotation, centre - rotation @ measured_centre, np.linalg.inv(information))

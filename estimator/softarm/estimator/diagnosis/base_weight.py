"""The weight of an arm on a base that yields."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects import World
from softarm.estimator.response import ArmResponse
from softarm.estimator.simulation import Drive


@dataclass(frozen=True)
class BaseWeight:
    """How weight acts on small rotations of a base about its x and y, in every pose.

    Args:
        by_rotation: G: strains by which the arm gives way, per rotation, shape (samples, strains, 2).
        restoring: k [N m/rad]: moment that turns an arm of constant shape back, per rotation, shape
            (samples, 2, 2).
    """

    by_rotation: Floats
    restoring: Floats

    @classmethod
    def of(
        cls, world: World, drive: Drive, response: ArmResponse, strains_by_gravity: Floats
    ) -> "BaseWeight":
        """Weigh an arm along a response.

        Args:
            world: Its masses.
            drive: What acts on it.
            response: Its response to that.
            strains_by_gravity: Derivative of the strains, shape (samples, strains, 3).
        """
        gravity = drive.gravity
        turned = np.stack([-np.cross(axis, gravity) for axis in np.eye(3)[:2]], axis=-1)
        levers = world.first_moment(response.frames.positions, response.frames.rotations)
        weights = np.einsum("ti,ti->t", levers, gravity)[:, None, None] * np.eye(3)
        restoring = (weights - levers[:, :, None] * gravity[:, None, :])[:, :2, :2]
        return cls(strains_by_gravity @ turned, 0.5 * (restoring + np.swapaxes(restoring, 1, 2)))

    def at_rest(self, rotation: Floats, compliance: float, stiffness: Floats) -> Floats:
        """Return where a base rests of which the arm's weight follows the rotation.

        The arm's strains change by e = G r, so that (1 + C (k - G^T K G)) r = C M. Where that has no stable
        solution, the arm would fall over; there r is C M.

        Args:
            rotation: C M, M being the moment without it [rad], shape (samples, 3).
            compliance: C [rad/(N m)].
            stiffness: K of the arm, shape (samples, strains, strains).

        Returns:
            r [rad], shape (samples, 3).
        """
        softer = np.swapaxes(self.by_rotation, 1, 2) @ stiffness @ self.by_rotation
        matrix = np.eye(2) + compliance * (self.restoring - 0.5 * (softer + np.swapaxes(softer, 1, 2)))
        known = np.flatnonzero(np.isfinite(matrix).all(axis=(1, 2)))
        stable = known[np.linalg.eigvalsh(matrix[known])[:, 0] > 0.0]
        rested = rotation.copy()
        rested[stable, :2] = np.linalg.solve(matrix[stable], rotation[stable, :2, None])[..., 0]
        return rested

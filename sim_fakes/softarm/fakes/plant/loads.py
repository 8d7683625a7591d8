"""What pulls and pushes on the arm: cords, hands, forces, tethers, obstacles; all in the base frame."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.parameters import ForceLoad, Obstacle

HAND_MASS = 0.05
SLIP_SPEED = 0.005
CONTACT_TIME = 0.01


@dataclass(frozen=True)
class TautLine:
    """A line that pulls and never pushes.

    Args:
        length: Up to which it is slack [m].
        stiffness: Of the taut line [N/m].
        damping: Of the taut line [N s/m].
    """

    length: float
    stiffness: float
    damping: float = 0.0

    def pull(self, knot: Floats, velocity: Floats, end: Floats) -> tuple[Floats, float]:
        """Return the force on the knot [N], shape (3,), and the tension [N].

        Args:
            knot: Where it is tied to the arm [m], shape (3,).
            velocity: Of the knot relative to the other end [m/s], shape (3,).
            end: Its other end [m], shape (3,).
        """
        reach = end - knot
        span = float(np.linalg.norm(reach))
        if span <= self.length or span == 0.0:
            return np.zeros(3), 0.0
        direction = reach / span
        tension = self.stiffness * (span - self.length) - self.damping * float(direction @ velocity)
        tension = max(0.0, tension)
        return tension * direction, tension


def grasp(force: Floats, target: Floats, stiffness: float, position: Floats, velocity: Floats) -> Floats:
    """Return the force of a hand [N]: a constant, and a spring damped as if it held 50 g critically."""
    damping = 2.0 * np.sqrt(stiffness * HAND_MASS)
    return np.asarray(force + stiffness * (target - position) - damping * velocity)


def strength(force: ForceLoad, time: float) -> float:
    """Return the share of its amplitude that a force has at a time [s]."""
    if time < force.start:
        return 0.0
    if force.period <= 0.0:
        return 1.0
    return float(np.sin(2.0 * np.pi * (time - force.start) / force.period))


def contact(obstacle: Obstacle, points: Floats, radii: Floats, velocities: Floats) -> Floats:
    """Return the forces of an obstacle on spheres [N], shape (points, 3).

    Args:
        obstacle: Plane or cylinder; it yields like a damped spring and rubs like Coulomb.
        points: Centres of the spheres [m], shape (points, 3).
        radii: Of the spheres [m], shape (points,).
        velocities: Of the centres [m/s], shape (points, 3).
    """
    direction = np.array(obstacle.direction) / np.linalg.norm(obstacle.direction)
    away = points - np.array(obstacle.point)
    if obstacle.kind == "cylinder":
        away = away - np.outer(away @ direction, direction)
        distance = np.linalg.norm(away, axis=1)
        normals = away / np.maximum(distance, 1e-9)[:, None]
        depth = radii + obstacle.radius - distance
    else:
        normals = np.broadcast_to(direction, points.shape)
        depth = radii - away @ direction
    speed = np.einsum("pk,pk->p", normals, velocities)
    press = np.where(depth > 0.0, np.maximum(0.0, obstacle.stiffness * (depth - CONTACT_TIME * speed)), 0.0)
    sliding = velocities - speed[:, None] * normals
    rub = sliding / np.sqrt(np.einsum("pk,pk->p", sliding, sliding) + SLIP_SPEED**2)[:, None]
    return np.asarray(press[:, None] * (normals - obstacle.friction * rub))

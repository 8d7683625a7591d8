"""An arm of two segments of evenly bending links: small, exact, and off balance while iterating."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from softarm.estimator.model import Frames, Inputs, Load
from softarm.estimator.rotations import exp_kernel, jacobian_kernel

LENGTH = 0.13
LINKS = 2
STIFFNESS = np.array([0.04, 0.04, 0.03, 12.0] * 2)  # bending, bending, torsion [N m rad-1], stretch [N m-1]
AZIMUTHS = np.radians([0.0, 120.0, 240.0])


def chamber_map() -> np.ndarray:
    """Generalised force per pressure, shape (8, 6)."""
    area, lever = 2e-4, 0.011
    forces = np.zeros((8, 6))
    for segment in range(2):
        for k, azimuth in enumerate(AZIMUTHS):
            column = forces[4 * segment : 4 * segment + 4, 3 * segment + k]
            column[:2] = area * lever * np.array([-np.sin(azimuth), np.cos(azimuth)])
            column[3] = 0.02 * area
    return forces


FORCES = chamber_map()


@njit(cache=True)
def chain(strain, height):
    """Place a height on a chain of straight links, each with its turn at half its length.

    Returns its position, rotation and the derivative of its twist by the strain.
    """
    position, rotation, twists = np.zeros(3), np.eye(3), np.zeros((6, 8))
    turn, jacobian = np.empty((1, 3, 3)), np.empty((1, 3, 3))
    for pass_ in range(2):
        end = position.copy()
        position, rotation = np.zeros(3), np.eye(3)
        for link in range(2 * LINKS):
            segment = 4 * (link // LINKS)
            share = min(max(height * LINKS / LENGTH - link, 0.0), 1.0)
            part = (share / LINKS * strain[segment : segment + 3]).reshape(1, 3)
            half = share * (LENGTH + strain[segment + 3]) / LINKS / 2
            exp_kernel(part, turn)
            joint = position + half * rotation[:, 2]
            after = rotation @ turn[0]
            if pass_ == 1:
                jacobian_kernel(part, jacobian)
                spin = rotation @ jacobian[0] * (share / LINKS)
                for k in range(3):
                    twists[3:, segment + k] += spin[:, k]
                    for a in range(3):
                        b, c = (a + 1) % 3, (a + 2) % 3
                        twists[a, segment + k] += spin[b, k] * (end[c] - joint[c])
                        twists[a, segment + k] -= spin[c, k] * (end[b] - joint[b])
                twists[:3, segment + 3] += share / LINKS / 2 * (rotation[:, 2] + after[:, 2])
            position = joint + half * after[:, 2]
            rotation = after
    return position, rotation, twists


@dataclass(frozen=True)
class ToyStep:
    model: "ToyArm"
    strain: np.ndarray
    inputs: Inputs

    @property
    def frames(self) -> Frames:
        return self.model.frames(self.strain)

    @property
    def residual_norm(self) -> float:
        applied = np.linalg.norm(self.model.applied(self.strain, self.inputs)) + 1e-9
        return float(np.linalg.norm(self.residual) / applied)

    @property
    def residual(self) -> np.ndarray:
        return self.model.applied(self.strain, self.inputs) - self.model.internal(self.strain)

    @cached_property
    def moves(self) -> tuple[np.ndarray, np.ndarray]:
        def out_of_balance(strain: np.ndarray) -> np.ndarray:
            return self.model.internal(strain) - self.model.applied(strain, self.inputs)

        tangent = difference(out_of_balance, self.strain)
        vectors = np.column_stack([FORCES, self.model.load_vectors(self.strain).T])
        return np.linalg.solve(tangent, self.residual), np.linalg.solve(tangent, vectors)

    def response(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        twists = self.model.twist_jacobian(self.strain)
        drift, motion = self.moves
        return rows @ twists @ drift, rows @ twists @ motion


def difference(function: Callable[[np.ndarray], np.ndarray], point: np.ndarray) -> np.ndarray:
    steps = 1e-5 * np.eye(len(point))
    return np.column_stack([(function(point + d) - function(point - d)) / 2e-5 for d in steps])


@dataclass(frozen=True)
class ToyArm:
    loads: tuple[Load, ...]
    sections: tuple[str, ...] = ("intermediate", "tip")
    chambers: int = 6
    mass: float = 0.02

    def rest(self) -> np.ndarray:
        return np.zeros(8)

    def frames(self, strain: np.ndarray) -> Frames:
        middle, tip = chain(strain, LENGTH), chain(strain, 2 * LENGTH)
        return Frames(np.array([middle[0], tip[0]]), np.array([middle[1], tip[1]]))

    def twist_jacobian(self, strain: np.ndarray) -> np.ndarray:
        return np.concatenate([chain(strain, LENGTH)[2], chain(strain, 2 * LENGTH)[2]])

    @cached_property
    def heights(self) -> list[float]:
        places = {"intermediate": LENGTH, "tip": 2 * LENGTH}
        return [places.get(load.section or "", load.height) for load in self.loads]

    @cached_property
    def directions(self) -> np.ndarray:
        """Force, then couple of each load per unit, shape (loads, 6)."""
        directions = np.zeros((len(self.loads), 6))
        for row, load in zip(directions, self.loads, strict=True):
            row[slice(0, 3) if load.kind == "force" else slice(3, 6)] = load.direction
        return directions

    def load_vectors(self, strain: np.ndarray) -> np.ndarray:
        """Generalised force per unit of each load, shape (loads, 8)."""
        twists = {height: chain(strain, height)[2] for height in set(self.heights)}
        vectors = [d @ twists[h] for d, h in zip(self.directions, self.heights, strict=True)]
        return np.array(vectors).reshape(-1, 8)

    def applied(self, strain: np.ndarray, inputs: Inputs) -> np.ndarray:
        middle, tip = chain(strain, LENGTH)[2], chain(strain, 2 * LENGTH)[2]
        weight = self.mass * inputs.gravity @ (middle[:3] + tip[:3])
        return FORCES @ inputs.pressures + inputs.loads @ self.load_vectors(strain) + weight

    def internal(self, strain: np.ndarray) -> np.ndarray:
        return STIFFNESS * strain * (1.0 + 0.3 * strain @ strain)

    def refreshed(self, state: np.ndarray) -> np.ndarray:
        return state

    def linearise(self, state: np.ndarray, inputs: Inputs) -> ToyStep:
        return ToyStep(self, state, inputs)

    def advance(self, step: ToyStep, change: np.ndarray) -> np.ndarray:
        drift, motion = step.moves
        return step.strain + drift + motion @ change

    def solve(self, inputs: Inputs, start: np.ndarray) -> tuple[np.ndarray, bool]:
        state = start
        for _ in range(30):
            step = self.linearise(state, inputs)
            if step.residual_norm < 1e-11:
                return state, True
            state = self.advance(step, np.zeros(6 + len(self.loads)))
        return state, False

    def with_loads(self, loads: tuple[Load, ...]) -> "ToyArm":
        return replace(self, loads=loads)

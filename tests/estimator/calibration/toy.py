"""A model with an answer on paper: two segments of constant curvature, each bent by its three chambers.

The bend of a segment is the chambers' push over its stiffness and that which gravity adds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames, Inputs, Load
from softarm.estimator.rotations import exp

AZIMUTHS = np.arange(3) * 2 * np.pi / 3
PUSH = -2e-5 * np.array([np.cos(AZIMUTHS), np.sin(AZIMUTHS)])  # rad per Pa at a stiffness of one
LENGTH = 0.14
PULL = 0.3  # rad per N on a section below, likewise

STEP = 1e-6


@dataclass(frozen=True)
class ToyStep:
    model: "ToyModel"
    inputs: Inputs

    @cached_property
    def frames(self) -> Frames:
        return self.model.frames(self.inputs)

    @property
    def residual_norm(self) -> float:
        return 0.0

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        count = 6 + len(self.model.loads)
        inputs = np.concatenate([self.inputs.pressures, self.inputs.loads]) + np.eye(count)
        moved = self.model.batch(inputs[:, :6], np.tile(self.model.scales, (count, 1)), inputs[:, 6:])
        return np.zeros(len(rows)), rows @ twists(self.frames, moved).T

    def full_response(self, rows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        drift, input_jacobian = self.response(rows)
        return drift, input_jacobian, np.zeros((len(rows), 3)), self.parameter_response(rows)

    def parameter_response(self, rows: Floats) -> Floats:
        scales = self.model.scales + STEP * np.eye(2)
        pressures, loads = (np.tile(part, (2, 1)) for part in (self.inputs.pressures, self.inputs.loads))
        moved = self.model.batch(pressures, scales, loads)
        return rows @ twists(self.frames, moved).T / STEP


def twists(one: Frames, others: Frames) -> Floats:
    turned = others.rotations @ np.swapaxes(one.rotations, -1, -2)
    skew = 0.5 * (turned - np.swapaxes(turned, -1, -2))
    rotation = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    return np.concatenate([others.positions - one.positions, rotation], axis=-1).reshape(-1, 18)


@dataclass(frozen=True)
class ToyModel:
    scales: Floats
    loads: tuple[Load, ...] = ()

    sections = ("base", "intermediate", "tip")
    chambers = 6
    parameters = ("upper", "lower")

    def with_scales(self, scales: Mapping[str, float]) -> "ToyModel":
        values = [scales.get(name, old) for name, old in zip(self.parameters, self.scales, strict=True)]
        return replace(self, scales=np.array(values))

    def rest(self) -> None:
        return None

    def refreshed(self, state: None) -> None:
        return None

    def linearise(self, state: None, inputs: Inputs) -> ToyStep:
        return ToyStep(self, inputs)

    def advance(self, step: ToyStep, change: Floats) -> None:
        return None

    def solve(self, inputs: Inputs, start: None) -> tuple[None, bool]:
        return None, bool(np.isfinite(inputs.pressures).all())

    def frames(self, inputs: Inputs) -> Frames:
        found = self.batch(inputs.pressures[None], self.scales[None], inputs.loads[None])
        return Frames(found.positions[0], found.rotations[0])

    def batch(self, pressures: Floats, scales: Floats, loads: Floats) -> Frames:
        """Return frames for many pressures, shape (samples, 6), factors, shape (samples, 2), and loads."""
        samples = len(pressures)
        positions, rotations = np.zeros((samples, 3, 3)), np.zeros((samples, 3, 3, 3))
        rotations[:, 0] = np.eye(3)
        for k in range(2):
            # Gravity pulls a bend straight, which tells stiffness from the gain of the pressures.
            pulls = [
                load.direction[:2] if load.section in self.sections[k + 1 :] else (0, 0)
                for load in self.loads
            ]
            push = pressures[:, 3 * k : 3 * k + 3] @ PUSH.T + PULL * loads @ np.reshape(pulls, (-1, 2))
            bend = push / (scales[:, k, None] + 0.3)
            axis = np.column_stack([-bend[:, 1], bend[:, 0], np.zeros(samples)])
            above = rotations[:, k]
            reach = above @ exp(0.5 * axis) @ np.array([0.0, 0.0, LENGTH])
            positions[:, k + 1] = positions[:, k] + reach
            rotations[:, k + 1] = above @ exp(axis)
        return Frames(positions, rotations)


def toy(loads: tuple[Load, ...] = ()) -> ToyModel:
    return ToyModel(np.ones(2), loads)

"""A model with an answer on paper: two segments of constant curvature, each bent by its three chambers.

The bend of a segment is the chambers' push over its stiffness and that which gravity adds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.model import Frames, Inputs, Load
from estimator.rotations import exp

Floats = NDArray[np.float64]

AZIMUTHS = np.arange(3) * 2 * np.pi / 3
PUSH = -2e-5 * np.array([np.cos(AZIMUTHS), np.sin(AZIMUTHS)])  # rad per Pa at a stiffness of one
LENGTH = 0.14


@dataclass(frozen=True)
class ToyStep:
    model: "ToyModel"
    inputs: Inputs

    @property
    def frames(self) -> Frames:
        return self.model.frames(self.inputs)

    @property
    def residual_norm(self) -> float:
        return 0.0

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        columns = [self._twist(replace_pressure(self.inputs, k, 1.0), 1.0) for k in range(6)]
        return np.zeros(len(rows)), rows @ np.column_stack(columns)

    def parameter_response(self, rows: Floats) -> Floats:
        columns = []
        for k in range(2):
            scales = self.model.scales.copy()
            scales[k] += 1e-6
            changed = replace(self.model, scales=scales).frames(self.inputs)
            columns.append(twist(self.frames, changed) / 1e-6)
        return rows @ np.column_stack(columns)

    def _twist(self, inputs: Inputs, size: float) -> Floats:
        return twist(self.frames, self.model.frames(inputs)) / size


def replace_pressure(inputs: Inputs, chamber: int, change: float) -> Inputs:
    pressures = inputs.pressures.copy()
    pressures[chamber] += change
    return Inputs(pressures, inputs.loads, inputs.gravity)


def twist(one: Frames, other: Frames) -> Floats:
    turned = other.rotations @ np.swapaxes(one.rotations, -1, -2)
    skew = 0.5 * (turned - np.swapaxes(turned, -1, -2))
    rotation = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    return np.concatenate([other.positions - one.positions, rotation], axis=1).reshape(-1)


@dataclass(frozen=True)
class ToyModel:
    scales: Floats

    sections = ("base", "intermediate", "tip")
    chambers = 6
    loads: tuple[Load, ...] = ()
    parameters = ("upper", "lower")

    def with_scales(self, scales: Mapping[str, float]) -> "ToyModel":
        values = [scales.get(name, old) for name, old in zip(self.parameters, self.scales, strict=True)]
        return replace(self, scales=np.array(values))

    def rest(self) -> None:
        return None

    def linearise(self, state: None, inputs: Inputs) -> ToyStep:
        return ToyStep(self, inputs)

    def advance(self, step: ToyStep, change: Floats) -> None:
        return None

    def solve(self, inputs: Inputs, start: None) -> tuple[None, bool]:
        return None, bool(np.isfinite(inputs.pressures).all())

    def frames(self, inputs: Inputs) -> Frames:
        positions, rotations = [np.zeros(3)], [np.eye(3)]
        for k, scale in enumerate(self.scales):
            # Gravity pulls a bend straight, which tells stiffness from the gain of the pressures.
            stiffness = scale + 0.3 * inputs.gravity[2] / 9.81
            bend = PUSH @ inputs.pressures[3 * k : 3 * k + 3] / stiffness
            turn = exp(np.array([-bend[1], bend[0], 0.0]))
            middle = exp(0.5 * np.array([-bend[1], bend[0], 0.0]))
            positions.append(positions[-1] + rotations[-1] @ middle @ [0.0, 0.0, LENGTH])
            rotations.append(rotations[-1] @ turn)
        return Frames(np.array(positions), np.array(rotations))


def toy() -> ToyModel:
    return ToyModel(np.ones(2))

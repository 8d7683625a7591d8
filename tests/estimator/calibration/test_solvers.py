"""Node by node or in a batch, a calibration sees the same arm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from toy import ToyModel, toy, twists

from softarm.estimator.calibration import BatchSolver, NodeSolver
from softarm.estimator.model import Frames, Inputs

Floats = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True)
class Answer:
    frames: Frames
    motion: Floats
    converged: NDArray[np.bool_]


@dataclass(frozen=True)
class BatchToy:
    inner: ToyModel

    sections = ToyModel.sections
    regions = ToyModel.parameters
    loads = ()

    def with_scales(self, scales: dict[str, float]) -> "BatchToy":
        return BatchToy(self.inner.with_scales(scales))

    def evaluate(self, pressures: Floats, loads: Floats, gravity: Floats) -> Answer:
        steps = [self.inner.linearise(None, Inputs(p, np.zeros(0), gravity)) for p in pressures]
        rows = np.eye(18)
        motion = [
            np.hstack([step.response(rows)[1], np.zeros((18, 3)), step.parameter_response(rows)])
            for step in steps
        ]
        frames = Frames(
            np.array([s.frames.positions for s in steps]), np.array([s.frames.rotations for s in steps])
        )
        return Answer(frames, np.array(motion), np.ones(len(steps), dtype=bool))


def test_both_solvers_give_the_same() -> None:
    pressures = np.random.default_rng(0).uniform(0, 4e4, (5, 6))
    scales = {"upper": 0.8, "lower": 1.2}
    one = NodeSolver(toy()).respond(scales, pressures, np.zeros((len(pressures), 0)), GRAVITY, None)
    other = BatchSolver(BatchToy(toy())).respond(
        {**scales, "foreign": 2.0}, pressures, np.zeros((len(pressures), 0)), GRAVITY, None
    )
    for name in ("by_load", "by_pressure", "by_factor", "converged"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name))
    np.testing.assert_allclose(one.frames.rotations, other.frames.rotations)


def test_a_response_keeps_chosen_nodes() -> None:
    whole = NodeSolver(toy()).respond(
        {}, np.arange(18.0).reshape(3, 6) * 1e3, np.zeros((3, 0)), GRAVITY, None
    )
    part = whole.keep(np.array([True, False, True]))
    assert len(part.memory) == len(part.converged) == 2
    np.testing.assert_array_equal(part.frames.positions, whole.frames.positions[[0, 2]])


def test_stiffness_factors_move_the_sections_as_differences_say() -> None:
    pressures = np.full((1, 6), 3e4) * [1, 0, 0.5, 0, 1, 0]
    at = NodeSolver(toy()).respond({"upper": 1.1}, pressures, np.zeros((len(pressures), 0)), GRAVITY, None)
    moved = NodeSolver(toy()).respond(
        {"upper": 1.1 + 1e-5}, pressures, np.zeros((len(pressures), 0)), GRAVITY, None
    )
    change = twists(Frames(at.frames.positions[0], at.frames.rotations[0]), moved.frames) / 1e-5
    np.testing.assert_allclose(at.by_factor[0, :, 0], change[0], atol=1e-4)

"""Sequential quadratic programming: inputs and state together, until both stand still."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar, cast

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.objectives import Iterate, Objective, WeightedRows
from softarm.estimator.inverse.program import build_program, solve_program
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation
from softarm.estimator.rotations import exp

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)
Status = Literal["converged", "iterations_exhausted", "diverged"]
INSIGNIFICANT = 1e-4
"""Rise of the cost out of equilibrium, over it and over one, below what any measurement resolves."""
REACH_GROWTH = 1.1
"""Factor by which a reach may grow from one instant to the next: one step may be bent little by chance."""


@dataclass(frozen=True)
class Tolerances:
    """When to stop.

    Args:
        step: Largest change of an input, in units of its scale.
        residual: Out-of-balance force over the applied forces.
        iterations: Largest number of new linearisations.
        radius: First radius of the trust region, in units of the inputs' scale.
        rejections: Largest number of rejected steps.
        forecast: Rise of the cost, over it and over one, that a step is allowed per out-of-balance force.
        solves_after_rejection: Whether the model is solved after the shorter step that replaces a rejected
            one; otherwise it is only linearised again before that step.
    """

    step: float = 1e-6
    residual: float = 1e-6
    iterations: int = 30
    radius: float = 4.0
    rejections: int = 6
    forecast: float = 10.0
    solves_after_rejection: bool = True


@dataclass(frozen=True)
class Linearised(Generic[State]):
    """Where a search last linearised the model: a later one under the same model can set out from there.

    Args:
        model: Model of the arm.
        state: Its state.
        inputs: Inputs there.
        step: The linearisation.
        reach: Size of a step from there that would leave one as large, in units of the inputs' scale: what
            is left grows with the square of a step. 0 where it is unknown.
    """

    model: ArmModel[State, Any]
    state: State
    inputs: Inputs
    step: Linearisation
    reach: float = 0.0

    def valid_for(self, model: ArmModel[State, Any], gravity: Floats) -> bool:
        """Return whether it is a linearisation of a model under a gravitational acceleration."""
        return self.model is model and np.array_equal(self.inputs.gravity, gravity)


@dataclass(frozen=True)
class Minimum(Generic[State]):
    """Where the search ended.

    Args:
        state: State of the model.
        frames: Frames of the sections there.
        vector: Pressures, then loads, shape (inputs,).
        motion: Derivative of the section twists by the inputs, shape (6 sections, inputs).
        rows: Rows of the objectives there.
        status: Whether it converged.
        iterations: Number of new linearisations.
        residual_norm: Relative out-of-balance force of the last linearised state.
        last: That state with its linearisation.
        reach: As of a ``Linearised``, by the first step of the search.
    """

    state: State
    frames: Frames
    vector: Floats
    motion: Floats
    rows: tuple[WeightedRows, ...]
    status: Status
    iterations: int
    residual_norm: float
    last: Linearised[State]
    reach: float


def minimise(
    model: ArmModel[State, Step],
    unknowns: Unknowns,
    objectives: Sequence[Objective],
    limits: InputBounds,
    start: tuple[State, Inputs],
    tolerances: Tolerances | None = None,
    warm_start: Linearised[State] | None = None,
) -> Minimum[State]:
    """Minimise the objectives over the inputs, the state in equilibrium with them.

    Each step linearises the model at the current state, which need not be in equilibrium, solves the
    quadratic program for the change of the inputs and takes the Newton step of the state for them. A step
    that makes matters worse is taken back and the trust region shrunk to a quarter.

    Args:
        model: Model of the arm.
        unknowns: Names and scales of the inputs.
        objectives: What the inputs should meet.
        limits: Bounds and held inputs.
        start: A state and inputs to begin with.
        tolerances: When to stop.
        warm_start: Where an earlier search linearised the model; used in place of ``start`` where it serves.
    """
    tolerances = tolerances or Tolerances()
    state, inputs = start
    if warm_start is not None and warm_start.valid_for(model, inputs.gravity):
        search = _Search(model, unknowns, tuple(objectives), limits, tolerances, warm_start.reach)
        return search.run(search.resumed(warm_start), inputs.gravity, 0)
    search = _Search(model, unknowns, tuple(objectives), limits, tolerances)
    return search.run(search.linearised(state, inputs), inputs.gravity, 1)


def linearise_at(
    model: ArmModel[State, Step],
    unknowns: Unknowns,
    objectives: Sequence[Objective],
    limits: InputBounds,
    minimum: Minimum[State],
    gravity: Floats,
) -> Linearised[State]:
    """Linearise where a search ended, and measure what its last step left.

    A later search that sets out from there needs one step where that leaves little enough. This is the
    preparation phase of the real-time iteration of M. Diehl, H. G. Bock and J. P. Schloeder (SIAM J. Control
    Optim. 43, 2005).

    Args:
        model: Model of the arm; its linearisations are in equilibrium.
        unknowns: As of the search.
        objectives: Likewise.
        limits: Likewise.
        minimum: Where it ended.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
    """
    search = _Search(model, unknowns, tuple(objectives), limits, Tolerances())
    inputs, reach = unknowns.inputs(minimum.vector, gravity), minimum.reach
    point = search.linearised(minimum.state, inputs)
    _, left = search.change(point, search.tolerances.radius)
    if not (math.isfinite(left) and math.isfinite(point.residual_norm)):
        return minimum.last
    if minimum.iterations == 0:
        change = (minimum.vector - unknowns.vector(minimum.last.inputs)) / unknowns.scale
        reach = _reach(float(np.abs(change).max(initial=0.0)), left, reach)
    return Linearised(model, point.state, inputs, point.step, reach)


def _reach(size: float, left: float, before: float) -> float:
    """Return the reach from what a step left, and from the reach before."""
    measured = size**2 / left if left > 0.0 else math.inf
    return min(measured, REACH_GROWTH * before) if before > 0.0 else measured


@dataclass(frozen=True)
class _Point(Generic[State, Step]):
    """A linearised iterate."""

    state: State
    step: Step
    at: Iterate
    rows: tuple[WeightedRows, ...]
    cost: float
    residual_norm: float


@dataclass(frozen=True)
class _Search(Generic[State, Step]):
    model: ArmModel[State, Step]
    unknowns: Unknowns
    objectives: tuple[Objective, ...]
    limits: InputBounds
    tolerances: Tolerances
    reach: float = 0.0

    def linearised(self, state: State, inputs: Inputs) -> _Point[State, Step]:
        """Begin anew."""
        return self._linearise(state, self.unknowns.vector(inputs), inputs.gravity)

    def resumed(self, warm_start: Linearised[State]) -> _Point[State, Step]:
        """Begin where the model is linearised already."""
        return self._point(
            warm_start.state, self.unknowns.vector(warm_start.inputs), cast("Step", warm_start.step)
        )

    def run(self, point: _Point[State, Step], gravity: Floats, iterations: int) -> Minimum[State]:
        """Search from a point that took a number of linearisations."""
        radius, last, rejections = self.tolerances.radius, self.reach, 0
        reach, second = self.reach, iterations + 1
        while True:
            change, size = self.change(point, radius)
            if not np.isfinite(size):
                return self._end(point, np.zeros_like(change), "diverged", iterations, gravity, reach)
            if iterations == second:
                reach = _reach(last, size, self.reach)
            # Steps shrink by this rate, so the next one, which is the error left, is about as much smaller;
            # the first one by the estimated curvature.
            rate = min(size / last, 1.0) if last > 0.0 else 1.0
            settled = point.residual_norm * rate < self.tolerances.residual
            if size * rate < self.tolerances.step and settled:
                return self._end(point, change, "converged", iterations, gravity, reach)
            if iterations >= self.tolerances.iterations or radius < 1e-8:
                return self._end(point, change, "iterations_exhausted", iterations, gravity, reach)
            candidate = self._linearise(
                self.model.advance(point.step, change), point.at.vector + change, gravity
            )
            iterations += 1
            if not self._improves(point, candidate):
                if iterations >= self.tolerances.iterations or rejections >= self.tolerances.rejections:
                    return self._end(point, 0.0 * change, "diverged", iterations, gravity, reach)
                rejections += 1
                # A quarter of the step that failed: the region may be far larger than that.
                radius, last = 0.25 * min(radius, size), 0.0
                if self.tolerances.solves_after_rejection:
                    candidate = self._settled(point, radius, gravity)
                else:
                    candidate = self._refreshed(point, gravity)
                iterations += 1
            else:
                radius, last = min(2.0 * radius, self.tolerances.radius), size
            point = candidate

    def _linearise(self, state: State, vector: Floats, gravity: Floats) -> _Point[State, Step]:
        return self._point(state, vector, self.model.linearise(state, self.unknowns.inputs(vector, gravity)))

    def _point(self, state: State, vector: Floats, step: Step) -> _Point[State, Step]:
        at = Iterate(step.frames, vector, self.unknowns.chambers, step.response)
        rows = tuple(objective.rows(at) for objective in self.objectives)
        return _Point(state, step, at, rows, sum(row.cost for row in rows), step.residual_norm)

    def change(self, point: _Point[State, Step], radius: float) -> tuple[Floats, float]:
        """Return the best change of the inputs within a radius, and its size in units of their scale."""
        program = build_program(point.rows, self.limits, point.at.vector, self.unknowns.scale, radius)
        scaled = solve_program(program)
        return scaled * self.unknowns.scale, float(np.abs(scaled).max(initial=0.0))

    def _improves(self, point: _Point[State, Step], candidate: _Point[State, Step]) -> bool:
        """Accept what is finite, not far out of balance, and does not raise the cost noticeably."""
        if not (np.isfinite(candidate.cost) and np.isfinite(candidate.residual_norm)):
            return False
        # Out of balance by more than all applied forces, a linearisation does not predict the equilibrium.
        if candidate.residual_norm > max(1.0, 2.0 * point.residual_norm):
            return False
        # Out of equilibrium the cost is a forecast, so only a clear rise counts.
        off = max(point.residual_norm, candidate.residual_norm)
        slack = 1e-6 + self.tolerances.forecast * off + min(50.0 * off, INSIGNIFICANT)
        return candidate.cost <= point.cost * (1.0 + slack) + slack

    def _refreshed(self, point: _Point[State, Step], gravity: Floats) -> _Point[State, Step]:
        """Linearise afresh where a step began that was taken back: an old factor may have misled it."""
        return self._linearise(self.model.refreshed(point.state), point.at.vector, gravity)

    def _settled(self, point: _Point[State, Step], radius: float, gravity: Floats) -> _Point[State, Step]:
        """Take a shorter step and let the model find its equilibrium there."""
        change, _ = self.change(point, radius)
        vector = point.at.vector + change
        state, settled = self.model.solve(self.unknowns.inputs(vector, gravity), point.state)
        candidate = self._linearise(state, vector, gravity)
        return candidate if settled and candidate.cost <= point.cost * (1.0 + 1e-6) + 1e-9 else point

    def _end(
        self,
        point: _Point[State, Step],
        change: Floats,
        status: Status,
        iterations: int,
        gravity: Floats,
        reach: float,
    ) -> Minimum[State]:
        """Move everything by the last, negligible step without linearising again."""
        drift, motion = point.step.response(np.eye(6 * len(self.model.sections)))
        return Minimum(
            state=self.model.advance(point.step, change),
            frames=_moved(point.at.frames, drift + motion @ change),
            vector=point.at.vector + change,
            motion=motion,
            rows=tuple(row.moved(change) for row in point.rows),
            status=status,
            iterations=iterations,
            residual_norm=point.residual_norm,
            last=Linearised(
                self.model, point.state, self.unknowns.inputs(point.at.vector, gravity), point.step
            ),
            reach=reach,
        )


def _moved(frames: Frames, twists: Floats) -> Frames:
    parts = twists.reshape(-1, 6)
    return Frames(frames.positions + parts[:, :3], exp(parts[:, 3:]) @ frames.rotations)

"""A model that solves one sample at a time, made to answer many."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.rotations import exp
from softarm.estimator.wrapper import ModelWrapper

NEAR = 1e-3  # out-of-balance force over the applied one, at which a Newton step leaves about its square
NEWTON_STEPS = 12
PARTS = 2  # of the samples, solved side by side; always as many, so that every machine finds the same
LARGEST_MOVE = 0.01  # rad or m; a Newton step that still moves a section by more is taken, not extrapolated
GRAVITY_STEP = 0.5  # m/s2, of the difference that gives the derivative by gravity

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


@dataclass(frozen=True)
class SolvedSample:
    """Where the solve of a sample ended, to begin another one with.

    Args:
        state: The model's state.
        inputs: Inputs that it is in equilibrium under.
        scales: The model's stiffness factors, shape (parameters,).
        motions: Displacement of what is left to equilibrium, then per unit of each pressure, load, component
            of gravity and factor, in single precision; ``None`` where the model does not provide it.
    """

    state: Any
    inputs: Inputs
    scales: Floats
    motions: NDArray[np.float32] | None = None

    def under(self, model: ArmModel[Any, Any], inputs: Inputs) -> Any:
        """Predict the state of a model with other stiffness factors under other inputs."""
        if self.motions is None:
            return self.state
        change = np.concatenate(
            [
                [1.0],
                inputs.pressures - self.inputs.pressures,
                inputs.loads - self.inputs.loads,
                inputs.gravity - self.inputs.gravity,
                _scales(model) - self.scales,
            ]
        )
        return cast(Any, model).displace(self.state, np.tensordot(change, self.motions, 1), inputs)


@dataclass(frozen=True)
class SequentialBatchModel(ModelWrapper):
    """Solves a model sample by sample, each begun from its own last state or from that of a similar one.

    It implements ``BatchArmModel``; stiffness factors are the model's ``parameters``, where it has any.

    Args:
        advance: Called with 1 after each sample, from several threads.
    """

    model: ArmModel[Any, Any]
    advance: Callable[[float], None] = lambda _: None

    takes_eigenstrains = False

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions whose stiffness can be scaled."""
        return tuple(getattr(self.model, "parameters", ()))

    def with_scales(self, scales: Mapping[str, float]) -> Self:
        """Return a copy with other stiffness factors."""
        own_scales = {name: factor for name, factor in scales.items() if name in self.regions}
        return replace(self, model=cast(Any, self.model).with_scales(own_scales)) if own_scales else self

    def evaluate(
        self,
        inputs: BatchInputs,
        *,
        start: ArmResponse | None = None,
        jacobians: bool = True,  # noqa: ARG002
    ) -> ArmResponse:
        """Solve many samples; see ``BatchArmModel.evaluate``.

        What the last Newton step of a sample still moves is extrapolated.
        """
        assert inputs.eigenstrains is None, "this model takes no eigenstrains"
        samples, rows = len(inputs), 6 * len(self.sections)
        frames = Frames(np.zeros((samples, rows // 6, 3)), np.zeros((samples, rows // 6, 3, 3)))
        response = ArmResponse(
            frames,
            np.zeros(samples, dtype=bool),
            self.chambers,
            np.zeros((samples, rows, self.chambers + len(self.loads) + 3)),
            np.zeros((samples, rows, len(self.regions))),
            states=np.empty(samples, dtype=object),
        )
        every = tuple(inputs.samples())
        parts = np.array_split(np.arange(samples), PARTS)
        with ThreadPoolExecutor(PARTS) as executor:
            # Iterating raises what a thread raised.
            for _ in executor.map(lambda part: self._solve_part(response, part, every, start), parts):
                pass
        return response

    def _solve_part(
        self, response: ArmResponse, part: Indices, inputs: Sequence[Inputs], start: ArmResponse | None
    ) -> None:
        """Solve some samples and enter them into the response.

        One without a state of its own begins at the solved one of most similar inputs, rest among them; the
        next is that which is closest to any of these.
        """
        rows = self.chambers + len(self.loads)
        none = Inputs(np.zeros(self.chambers), np.zeros(len(self.loads)), np.zeros(3))
        solved = [SolvedSample(self.model.rest(), none, _scales(self.model))]
        points = np.reshape(
            [np.append(inputs[k].pressures, inputs[k].loads) for k in part], (len(part), rows)
        )
        # Pascals and newtons are compared over their ranges.
        points /= np.maximum(np.abs(points).max(axis=0, initial=0.0), 1e-9)
        distance, nearest = np.linalg.norm(points, axis=1), np.zeros(len(part), dtype=np.int64)
        remaining = np.ones(len(part), dtype=bool)
        while remaining.any():
            place = int(np.argmin(np.where(remaining, distance, np.inf)))
            remaining[place], index = False, part[place]
            begin = solved[nearest[place]]
            # A sample's own state of an earlier solve is nearer than a neighbour's, unless that solve failed.
            if start is not None and start.converged[index]:
                begin = start.states[index]
            response.states[index] = sample = self._solve(response, index, begin, inputs[index])
            if response.converged[index]:
                apart = np.linalg.norm(points - points[place], axis=1)
                nearest[apart < distance] = len(solved)
                distance = np.minimum(distance, apart)
                solved.append(sample)
            self.advance(1)

    def _solve(self, response: ArmResponse, index: int, start: SolvedSample, inputs: Inputs) -> SolvedSample:
        """Solve a sample and enter it into the response."""
        scales = _scales(self.model)
        near = start.under(self.model, inputs)
        state, step, response.converged[index] = settle(self.model, start.state, inputs, near)
        response.frames.positions[index] = step.frames.positions
        response.frames.rotations[index] = step.frames.rotations
        if not response.converged[index]:
            # Without derivatives: this is no equilibrium to extrapolate from.
            return SolvedSample(state, inputs, scales)
        for _ in range(NEWTON_STEPS):
            drift, *jacobians = full_response(self.model, state, step, inputs)
            if np.abs(drift).max() <= LARGEST_MOVE:
                break
            state = self.model.advance(step, np.zeros(self.chambers + len(self.loads)))
            step = self.model.linearise(state, inputs)
        # What remains is short enough to go along the tangent, which costs no further factor.
        move = drift.reshape(-1, 6)
        response.frames.positions[index] = step.frames.positions + move[:, :3]
        response.frames.rotations[index] = exp(move[:, 3:]) @ step.frames.rotations
        by_inputs, by_gravity, by_factors = jacobians
        response.input_jacobian[index] = np.column_stack([by_inputs, by_gravity])
        # The chain rule converts a derivative by the factor into one by its logarithm.
        response.factor_jacobian[index] = by_factors * scales
        # In single precision: every sample keeps one field of nodes per input and factor.
        motions = getattr(step, "motions", None)
        return SolvedSample(state, inputs, scales, None if motions is None else motions.astype(np.float32))


def _scales(model: object) -> Floats:
    """Return the model's stiffness factors, none where it has none."""
    scales: Floats = getattr(model, "scales", np.zeros(0))
    return scales


def settle(
    model: ArmModel[State, Step], start: State, inputs: Inputs, near: State | None = None
) -> tuple[State, Step, bool]:
    """Bring a state near equilibrium by Newton steps, else by the model's own solver.

    Nearness is enough: what remains is one Newton step, which the linearisation gives as its drift.

    Args:
        model: The model.
        start: A state, best in equilibrium under its own inputs: the solver sets out from it.
        inputs: Inputs.
        near: A state that may be nearer, with which Newton steps begin.

    Returns:
        The state, the model linearised there, and whether it is near equilibrium.
    """
    state, last = start if near is None else near, np.inf
    for _ in range(NEWTON_STEPS):
        step = model.linearise(state, inputs)
        if step.residual_norm < NEAR:
            return state, step, True
        # Written so that NaN ends the loop as well.
        if not step.residual_norm < last:
            break
        last = step.residual_norm
        state = model.advance(step, np.zeros(model.chambers + len(model.loads)))
    state, converged = model.solve(inputs, start)
    return state, model.linearise(state, inputs), converged


def full_response(
    model: ArmModel[State, Step], state: State, step: Step, inputs: Inputs
) -> tuple[Floats, Floats, Floats, Floats]:
    """Project the motion of the section twists.

    A model that does not differentiate by gravity is linearised again under three others.

    Returns:
        Drift and change per input as ``Linearisation.response`` gives them, the change per component of
        gravity, shape (outputs, 3), and per stiffness factor, shape (outputs, parameters).
    """
    eye = np.eye(6 * len(model.sections))
    if hasattr(step, "full_response"):
        return cast(Any, step).full_response(eye)  # type: ignore[no-any-return]
    drift, by_inputs = step.response(eye)
    by_gravity = []
    # The out-of-balance force is linear in gravity, so that a difference is exact at any step.
    for axis in np.eye(3):
        nearby = model.linearise(state, replace(inputs, gravity=inputs.gravity + GRAVITY_STEP * axis))
        by_gravity.append((nearby.response(eye)[0] - drift) / GRAVITY_STEP)
    return drift, by_inputs, np.column_stack(by_gravity), np.zeros((len(eye), 0))

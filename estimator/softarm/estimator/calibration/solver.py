"""Where the sections are at many pressures, and how that changes, by any model of the arm."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.rotations import exp

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Memory = tuple[object, ...]

NEAR = 1e-3  # out-of-balance force over the applied one, at which a Newton step leaves about its square
NEWTON_STEPS = 12
LARGEST_MOVE = 0.01  # rad or m; a Newton step that still moves a section by more is taken, not extrapolated


@dataclass(frozen=True)
class Response:
    """Answers for many nodes.

    Args:
        frames: Frames of the sections, arrays with a leading axis (nodes,).
        by_pressure: Section twists per unit of each pressure, shape (nodes, 6 sections, chambers).
        by_load: Section twists per unit of each load, shape (nodes, 6 sections, loads).
        by_gravity: Section twists per component of gravity, shape (nodes, 6 sections, 3).
        by_factor: Section twists per unit of each stiffness factor, shape (nodes, 6 sections, factors).
        converged: Where an equilibrium was found, shape (nodes,).
        memory: The model's state at each node, for the next solve.
    """

    frames: Frames
    by_pressure: Floats
    by_load: Floats
    by_gravity: Floats
    by_factor: Floats
    converged: Flags
    memory: Memory

    def keep(self, flags: Flags) -> "Response":
        """Keep some nodes, shape (nodes,)."""
        return Response(
            Frames(self.frames.positions[flags], self.frames.rotations[flags]),
            self.by_pressure[flags],
            self.by_load[flags],
            self.by_gravity[flags],
            self.by_factor[flags],
            self.converged[flags],
            tuple(state for state, keep in zip(self.memory, flags, strict=True) if keep),
        )


class Solver(Protocol):
    """What a calibration knows of a model."""

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections."""

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the stiffness factors."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""

    def respond(
        self,
        scales: Mapping[str, float],
        pressures: Floats,
        loads: Floats,
        gravity: Floats,
        memory: Response | None,
    ) -> Response:
        """Solve at many pressures and loads.

        Args:
            scales: Stiffness factors; the model's own for those left out.
            pressures: Pressures in the chambers [Pa], shape (nodes, chambers).
            loads: Amplitudes of the model's loads [N or N m], shape (nodes, loads).
            gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
            memory: An earlier answer at the same nodes to start from.
        """


class ScaledLinearisation(Linearisation, Protocol):
    """A linearisation that also knows gravity and the stiffness factors."""

    def full_response(self, rows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Project the motion of the sections on rows.

        Returns:
            Drift and change per input as ``response`` gives them, the change per component of gravity, shape
            (outputs, 3), and per stiffness factor, shape (outputs, parameters).
        """


State = TypeVar("State")
Step = TypeVar("Step", bound=ScaledLinearisation)


class ScaledModel(ArmModel[State, Step], Protocol[State, Step]):
    """A model whose regions' stiffness can be scaled."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the stiffness factors."""

    def with_scales(self, scales: Mapping[str, float]) -> Self:
        """Copy the model with other stiffness factors."""


@dataclass(frozen=True)
class NodeSolver(Generic[State, Step]):
    """Solves a model node by node, each begun from its own last state or from its neighbour's.

    Args:
        model: The model.
        advance: Called with 1 after each node.
    """

    model: ScaledModel[State, Step]
    advance: Callable[[float], None] = lambda _: None

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections."""
        return tuple(self.model.sections)

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the stiffness factors."""
        return tuple(self.model.parameters)

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return tuple(self.model.loads)

    def respond(
        self,
        scales: Mapping[str, float],
        pressures: Floats,
        loads: Floats,
        gravity: Floats,
        memory: Response | None,
    ) -> Response:
        """Solve at many pressures and loads; see ``Solver.respond``."""
        model = self.model.with_scales(scales)
        nodes, sections = len(pressures), len(self.sections)
        found = Response(
            Frames(np.zeros((nodes, sections, 3)), np.zeros((nodes, sections, 3, 3))),
            np.zeros((nodes, 6 * sections, model.chambers)),
            np.zeros((nodes, 6 * sections, len(self.loads))),
            np.zeros((nodes, 6 * sections, 3)),
            np.zeros((nodes, 6 * sections, len(self.factors))),
            np.zeros(nodes, dtype=bool),
            (),
        )
        states: list[State] = []
        state = model.rest()
        for index, (acting, pulled) in enumerate(zip(pressures, loads, strict=True)):
            if memory is not None and memory.converged[index]:
                state = cast(State, memory.memory[index])
            inputs = Inputs(acting, pulled, gravity)
            state, found.converged[index] = self._settle(found, index, state, inputs, model)
            states.append(state)
            self.advance(1)
        return Response(
            found.frames,
            found.by_pressure,
            found.by_load,
            found.by_gravity,
            found.by_factor,
            found.converged,
            tuple(states),
        )

    def _settle(
        self, found: Response, index: int, start: State, inputs: Inputs, model: ScaledModel[State, Step]
    ) -> tuple[State, bool]:
        """Solve a node and put it among the answers; what its last Newton step moves is extrapolated."""
        state, step, converged = settle(model, start, inputs)
        found.frames.positions[index] = step.frames.positions
        found.frames.rotations[index] = step.frames.rotations
        if not converged:
            return state, False
        rows = np.eye(found.by_load.shape[1])
        for _ in range(NEWTON_STEPS):
            drift, by_input, by_gravity, by_factor = step.full_response(rows)
            if np.abs(drift).max() <= LARGEST_MOVE:
                break
            state = model.advance(step, np.zeros(model.chambers + len(model.loads)))
            step = model.linearise(state, inputs)
        move = drift.reshape(-1, 6)
        found.frames.positions[index] = step.frames.positions + move[:, :3]
        found.frames.rotations[index] = exp(move[:, 3:]) @ step.frames.rotations
        found.by_pressure[index] = by_input[:, : model.chambers]
        found.by_load[index] = by_input[:, model.chambers :]
        found.by_gravity[index] = by_gravity
        found.by_factor[index] = by_factor
        return state, True


def settle(model: ScaledModel[State, Step], start: State, inputs: Inputs) -> tuple[State, Step, bool]:
    """Bring a state near equilibrium by Newton steps, else by the model's own solver.

    Nearness is enough: what is left is one Newton step, which the linearisation gives as its drift.

    Returns:
        The state, the model linearised there, and whether it is near equilibrium.
    """
    state, last = start, np.inf
    for _ in range(NEWTON_STEPS):
        step = model.linearise(state, inputs)
        if step.residual_norm < NEAR:
            return state, step, True
        if not step.residual_norm < last:
            break
        last = step.residual_norm
        state = model.advance(step, np.zeros(model.chambers + len(model.loads)))
    state, found = model.solve(inputs, start)
    return state, model.linearise(state, inputs), found


class BatchAnswer(Protocol):
    """Answers of a model that solves many samples at once."""

    @property
    def frames(self) -> Frames:
        """Frames of the sections, arrays with a leading axis (samples,)."""

    @property
    def motion(self) -> Floats:
        """Section twists per unit of each input, component of gravity and stiffness factor."""

    @property
    def converged(self) -> Flags:
        """Where an equilibrium was found, shape (samples,)."""


class BatchModel(Protocol):
    """A model that solves many samples at once, such as the calibrated rod."""

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections."""

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions whose stiffness can be scaled."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""

    def with_scales(self, scales: Mapping[str, float]) -> Self:
        """Copy the model with other stiffness factors of some regions."""

    def evaluate(self, pressures: Floats, loads: Floats, gravity: Floats) -> BatchAnswer:
        """Solve samples of pressures and loads, motion by inputs, gravity and factors."""


@dataclass(frozen=True)
class BatchSolver:
    """Solves a model for all nodes at once.

    Args:
        model: The model.
    """

    model: BatchModel

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections."""
        return tuple(self.model.sections)

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the stiffness factors."""
        return tuple(self.model.regions)

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return tuple(self.model.loads)

    def respond(
        self,
        scales: Mapping[str, float],
        pressures: Floats,
        loads: Floats,
        gravity: Floats,
        memory: Response | None,  # noqa: ARG002
    ) -> Response:
        """Solve at many pressures and loads; see ``Solver.respond``."""
        model = self.model.with_scales({name: f for name, f in scales.items() if name in self.factors})
        answer = model.evaluate(pressures, loads, gravity)
        inputs = pressures.shape[1] + loads.shape[1]
        return Response(
            answer.frames,
            answer.motion[..., : pressures.shape[1]],
            answer.motion[..., pressures.shape[1] : inputs],
            answer.motion[..., inputs : inputs + 3],
            answer.motion[..., inputs + 3 :],
            answer.converged,
            (None,) * len(pressures),
        )

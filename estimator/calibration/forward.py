"""The model at every node: what the sensors should read, and how that changes with the unknowns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.calibration.nodes import Nodes
from estimator.calibration.parameters import Layout, Setting
from estimator.model import ArmModel, Frames, Inputs, Linearisation
from estimator.rotations import skew
from estimator.sensing import Scene, SensorSuite

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class ScaledLinearisation(Linearisation, Protocol):
    """A linearisation that also knows the stiffness factors."""

    def parameter_response(self, rows: Floats) -> Floats:
        """Differentiate outputs by the stiffness factors, shape (outputs, parameters)."""


NEAR = 1e-3  # out-of-balance force over the applied one, at which a Newton step leaves about its square
NEWTON_STEPS = 12

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
class Evaluation(Generic[State]):
    """The model at the nodes of one run, at some values of the unknowns.

    Args:
        innovation: Measured minus predicted, NaN where absent or not converged, shape (nodes, rows).
        jacobian: Derivative of the prediction by the unknowns, shape (nodes, rows, unknowns).
        rigid: Derivative by a rigid motion (translation, rotation) of the whole arm, which is what an error
            of the laboratory's registration looks like, shape (nodes, rows, 6).
        frames: Frames of the sections at each node.
        states: The model's state at each node, for a warm start.
        converged: Where the model found its equilibrium, shape (nodes,).
    """

    innovation: Floats
    jacobian: Floats
    rigid: Floats
    frames: Frames
    states: tuple[State, ...]
    converged: Flags


def rigid_motion(frames: Frames) -> Floats:
    """Give the stacked twists of the sections in a rigid motion (v, w) of all, shape (6 sections, 6)."""
    motion = np.zeros((len(frames.positions), 6, 6))
    motion[:] = np.eye(6)
    motion[:, :3, 3:] = -skew(frames.positions)
    return motion.reshape(-1, 6)


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


@dataclass(frozen=True)
class Forward(Generic[State, Step]):
    """A model, the unknowns and the nodes, ready to be evaluated.

    Args:
        model: Model of the arm with stiffness factors of one.
        layout: The unknowns.
        nodes: Nodes of each run.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
        advance: Called with 1 after each node.
    """

    model: ScaledModel[State, Step]
    layout: Layout
    nodes: tuple[Nodes, ...]
    gravity: Floats
    advance: Callable[[float], None] = lambda _: None

    def evaluate(
        self, values: Floats, starts: Sequence[Evaluation[State]] | None = None
    ) -> tuple[Evaluation[State], ...]:
        """Solve the model at every node.

        Args:
            values: Values of the unknowns, shape (unknowns,).
            starts: An earlier evaluation, whose states the solves start from; the neighbour's solution when
                left out.

        Returns:
            One evaluation per run.
        """
        setting = self.layout.setting(values)
        model = self.model.with_scales(setting.scales)
        earlier: Sequence[Evaluation[State] | None] = starts or [None] * len(self.nodes)
        return tuple(
            self._evaluate_run(model, setting, nodes, start)
            for nodes, start in zip(self.nodes, earlier, strict=True)
        )

    def _evaluate_run(
        self,
        model: ScaledModel[State, Step],
        setting: Setting,
        nodes: Nodes,
        start: Evaluation[State] | None,
    ) -> Evaluation[State]:
        suite = setting.aligned(nodes.run.suite)
        acting = setting.actuation.to_chamber(nodes.pressures)
        count = len(nodes.time)
        innovation = np.full((count, suite.size), np.nan)
        jacobian = np.zeros((count, suite.size, len(self.layout.parameters)))
        rigid = np.zeros((count, suite.size, 6))
        positions = np.zeros((count, len(model.sections), 3))
        rotations = np.zeros((count, len(model.sections), 3, 3))
        converged = np.zeros(count, dtype=bool)
        states: list[State] = []
        state = model.rest()
        for index, pressures in enumerate(acting):
            inputs = Inputs(pressures, np.zeros(len(model.loads)), self.gravity)
            begin = state if start is None or not start.converged[index] else start.states[index]
            state, step, converged[index] = settle(model, begin, inputs)
            states.append(state)
            positions[index], rotations[index] = step.frames.positions, step.frames.rotations
            if converged[index]:
                innovation[index], jacobian[index], rigid[index] = self._node(
                    step, suite, setting, nodes, index
                )
            self.advance(1)
        return Evaluation(innovation, jacobian, rigid, Frames(positions, rotations), tuple(states), converged)

    def _node(
        self, step: Step, suite: SensorSuite, setting: Setting, nodes: Nodes, index: int
    ) -> tuple[Floats, Floats, Floats]:
        """Give the innovation at one node and the derivatives of the prediction."""
        scene = Scene(step.frames, np.zeros(len(self.model.loads)))
        reading = nodes.readings[index]
        sensitivity = suite.sensitivity(scene, reading)
        twists = np.nan_to_num(sensitivity.twists)
        drift, by_input = step.response(twists)
        by_factor = step.parameter_response(twists)
        by_alignment = np.nan_to_num(suite.parameter_rows(scene, reading))
        jacobian = np.zeros((suite.size, len(self.layout.parameters)))
        for column, (_, kind, target) in enumerate(self._targets):
            if kind == "modulus":
                factor = by_factor[:, self.model.parameters.index(target)]
                jacobian[:, column] = factor * setting.scales[target]
            elif kind == "gain":
                jacobian[:, column] = by_input[:, int(target)] * nodes.pressures[index, int(target)]
            elif kind == "bias":
                jacobian[:, column] = by_input[:, int(target)]
            elif target in suite.parameter_names:
                jacobian[:, column] = by_alignment[:, suite.parameter_names.index(target)]
        return sensitivity.innovation - drift, jacobian, twists @ rigid_motion(step.frames)

    @property
    def _targets(self) -> tuple[tuple[str, str, str], ...]:
        return tuple((p.name, p.kind, p.target) for p in self.layout.parameters)

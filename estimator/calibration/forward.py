"""What the sensors should read at every node, and how that changes with the unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.calibration.nodes import Nodes
from estimator.calibration.parameters import Layout, Setting
from estimator.calibration.solver import Response, Solver
from estimator.model import Frames
from estimator.rotations import skew
from estimator.sensing import Scene, SensorSuite

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Evaluation:
    """The model at the nodes of one run, at some values of the unknowns.

    Args:
        innovation: Measured minus predicted, NaN where absent or not converged, shape (nodes, rows).
        jacobian: Derivative of the prediction by the unknowns, shape (nodes, rows, unknowns).
        rigid: Derivative by a rigid motion (translation, rotation) of the whole arm, which is what an error
            of the laboratory's registration looks like, shape (nodes, rows, 6).
        response: The model's answers.
    """

    innovation: Floats
    jacobian: Floats
    rigid: Floats
    response: Response

    @property
    def converged(self) -> Flags:
        """Where the model found its equilibrium, shape (nodes,)."""
        return self.response.converged

    @property
    def frames(self) -> Frames:
        """Frames of the sections at each node."""
        return self.response.frames

    def keep(self, flags: Flags) -> "Evaluation":
        """Keep some nodes, shape (nodes,)."""
        return Evaluation(
            self.innovation[flags], self.jacobian[flags], self.rigid[flags], self.response.keep(flags)
        )


@dataclass(frozen=True)
class Forward:
    """A model, the unknowns and the nodes, ready to be evaluated.

    Args:
        solver: Model of the arm.
        layout: The unknowns.
        nodes: Nodes of each run.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
    """

    solver: Solver
    layout: Layout
    nodes: tuple[Nodes, ...]
    gravity: Floats

    def evaluate(self, values: Floats, starts: Sequence[Evaluation] | None = None) -> tuple[Evaluation, ...]:
        """Solve the model at every node.

        Args:
            values: Values of the unknowns, shape (unknowns,).
            starts: An earlier evaluation of the same nodes, whose states the solves start from.

        Returns:
            One evaluation per run.
        """
        setting = self.layout.setting(values)
        earlier: Sequence[Evaluation | None] = starts or [None] * len(self.nodes)
        return tuple(
            self._evaluate_run(setting, nodes, start)
            for nodes, start in zip(self.nodes, earlier, strict=True)
        )

    def _evaluate_run(self, setting: Setting, nodes: Nodes, start: Evaluation | None) -> Evaluation:
        acting = setting.actuation.to_chamber(nodes.pressures)
        memory = start.response if start is not None else None
        response = self.solver.respond(setting.scales, acting, self.gravity, memory)
        suite = setting.aligned(nodes.run.suite)
        scene = Scene(response.frames, np.zeros((len(nodes.time), 0)))
        sensitivity = suite.sensitivity(scene, nodes.readings)
        twists = np.nan_to_num(sensitivity.twists)
        lost = ~response.converged[:, None]
        left = sensitivity.innovation - (twists @ response.drift[..., None])[..., 0]
        return Evaluation(
            np.where(lost, np.nan, left),
            self._jacobian(setting, suite, nodes, scene, twists, response),
            twists @ rigid_motion(response.frames),
            response,
        )

    def _jacobian(
        self,
        setting: Setting,
        suite: SensorSuite,
        nodes: Nodes,
        scene: Scene,
        twists: Floats,
        response: Response,
    ) -> Floats:
        by_pressure = twists @ response.by_pressure
        by_factor = twists @ response.by_factor
        by_alignment = np.nan_to_num(suite.parameter_rows(scene, nodes.readings))
        jacobian = np.zeros((*twists.shape[:2], len(self.layout.parameters)))
        for column, parameter in enumerate(self.layout.parameters):
            target = parameter.target
            if parameter.kind == "modulus":
                factor = by_factor[..., self.solver.factors.index(target)]
                jacobian[..., column] = factor * setting.scales[target]
            elif parameter.kind == "gain":
                chamber = int(target)
                jacobian[..., column] = by_pressure[..., chamber] * nodes.pressures[:, None, chamber]
            elif parameter.kind == "bias":
                jacobian[..., column] = by_pressure[..., int(target)]
            elif target in suite.parameter_names:
                jacobian[..., column] = by_alignment[..., suite.parameter_names.index(target)]
        return jacobian


def rigid_motion(frames: Frames) -> Floats:
    """Give the stacked twists of the sections in a rigid motion (v, w) of all, shape (..., 6 sections, 6)."""
    sections = frames.positions.shape[-2]
    motion = np.zeros((*frames.positions.shape[:-2], sections, 6, 6))
    motion[...] = np.eye(6)
    motion[..., :3, 3:] = -skew(frames.positions)
    return motion.reshape(*frames.positions.shape[:-2], 6 * sections, 6)

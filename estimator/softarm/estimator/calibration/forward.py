"""What the sensors should read at every node, and how that changes with the unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.layout import Layout
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.unknowns import Prediction
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse, BatchArmModel, BatchInputs
from softarm.estimator.simulation import Segments, with_segments


@dataclass(frozen=True)
class NodePredictions:
    """The model at the nodes of one run, at some values of the unknowns.

    Args:
        innovation: Measured minus predicted, NaN where absent or not converged, shape (nodes, rows).
        jacobian: Derivative of the prediction by the unknowns, shape (nodes, rows, unknowns).
        rigid: Derivative by a rigid motion (translation, rotation) of the whole arm, which is what an error
            of the laboratory's registration looks like, shape (nodes, rows, 6).
        response: The model's response.
    """

    innovation: Floats
    jacobian: Floats
    rigid: Floats
    response: ArmResponse

    @property
    def converged(self) -> Flags:
        """Where the model converged to an equilibrium, shape (nodes,)."""
        return self.response.converged

    @property
    def frames(self) -> Frames:
        """Frames of the sections at each node."""
        return self.response.frames

    def keep(self, flags: Flags) -> "NodePredictions":
        """Keep some nodes, shape (nodes,)."""
        return NodePredictions(
            self.innovation[flags], self.jacobian[flags], self.rigid[flags], self.response.at(flags)
        )


@dataclass(frozen=True)
class Forward:
    """A model, the unknowns and the nodes, ready to be evaluated.

    Args:
        model: Model of the arm.
        layout: The unknowns.
        nodes: Nodes of each run, whose gravity may differ from run to run.
        segments: The segments between the model's sections, where their compliances are among the unknowns.
    """

    model: BatchArmModel
    layout: Layout
    nodes: tuple[Nodes, ...]
    segments: Segments | None = None

    def evaluate(
        self, values: Floats, starts: Sequence[NodePredictions] | None = None
    ) -> tuple[NodePredictions, ...]:
        """Solve the model at every node; one evaluation per run.

        ``values`` has shape (unknowns,). The solves start from the states of ``starts``, an earlier
        evaluation of the same nodes.
        """
        setting = self.layout.setting(values)
        earlier: Sequence[NodePredictions | None] = starts or [None] * len(self.nodes)
        return tuple(
            self._evaluate_run(setting, nodes, start)
            for nodes, start in zip(self.nodes, earlier, strict=True)
        )

    def _evaluate_run(self, setting: Setting, nodes: Nodes, start: NodePredictions | None) -> NodePredictions:
        at = self.predict(setting, nodes, start.response if start is not None else None)
        converged = at.response.converged[:, None]
        innovation = np.where(converged, at.innovation, np.nan)
        return NodePredictions(innovation, self.layout.jacobian(at), at.rigid_jacobian, at.response)

    def predict(self, setting: Setting, nodes: Nodes, start: ArmResponse | None = None) -> Prediction:
        """Solve the calibrated model at the nodes of one run and compare it with the readings."""
        model, gravity = setting.model(self.model), nodes.run.gravity
        acting, pulls = setting.actuation.to_chamber(nodes.pressures), setting.pulls(nodes.loads)
        response = model.evaluate(BatchInputs(acting, pulls, setting.gravity(gravity)), start=start)
        if self.segments is not None:
            response = with_segments(response, model, self.segments)
        suite = setting.aligned(nodes.run.suite)
        sensitivity = suite.sensitivity(response.frames, nodes.readings)
        return Prediction(
            setting,
            suite,
            response,
            nodes.pressures,
            nodes.loads,
            gravity,
            nodes.readings,
            sensitivity.innovation,
            np.nan_to_num(sensitivity.twists),
        )

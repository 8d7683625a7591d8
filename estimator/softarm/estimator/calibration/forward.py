"""What the sensors should read at every node, and how that changes with the unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.parameters import Layout, Setting, gravity_axes
from softarm.estimator.calibration.pressures import by_unknown
from softarm.estimator.calibration.solver import Response, Solver
from softarm.estimator.calibration.stretched import respond
from softarm.estimator.model import Frames
from softarm.estimator.rotations import skew
from softarm.estimator.sensing import Marker, Scene, SectionPose, SensorSuite

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
        gravity, pulls = setting.gravity(self.gravity), setting.pulls(nodes.loads)
        response = respond(self.solver, setting.scales, setting.stretch, acting, pulls, gravity, memory)
        suite = setting.aligned(nodes.run.suite)
        scene = Scene(response.frames, np.zeros((len(nodes.time), 0)))
        sensitivity = suite.sensitivity(scene, nodes.readings)
        twists = np.nan_to_num(sensitivity.twists)
        lost = ~response.converged[:, None]
        left = sensitivity.innovation
        return Evaluation(
            np.where(lost, np.nan, left),
            self._jacobian(setting, suite, nodes, scene, twists, response, np.nan_to_num(left)),
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
        innovation: Floats,
    ) -> Floats:
        by_pressure = twists @ response.by_pressure
        by_factor = twists @ response.by_factor
        by_alignment = np.nan_to_num(suite.parameter_rows(scene, nodes.readings))
        moved = twists @ rigid_motion(response.frames) - lever(suite, innovation)
        by_base = -registered(suite)[:, None] * moved
        by_cord = by_azimuth(twists @ response.by_load, setting.pulls(nodes.loads))
        tilts = -skew(setting.gravity(self.gravity)) @ gravity_axes(self.gravity).T
        by_tilt = twists @ response.by_gravity @ tilts
        jacobian = np.zeros((*twists.shape[:2], len(self.layout.parameters)))
        for column, parameter in enumerate(self.layout.parameters):
            target = parameter.target
            match parameter.kind:
                case "modulus":
                    factor = by_factor[..., self.solver.factors.index(target)]
                    jacobian[..., column] = factor * setting.scales[target]
                case "gain" | "bias" | "curve" | "bow" | "crosstalk" | "stretch":
                    pushed = by_unknown(parameter, setting, response.frames, nodes.pressures)
                    jacobian[..., column] = (by_pressure @ pushed[..., None])[..., 0]
                case "base":
                    jacobian[..., column] = by_base[..., int(target)]
                case "gravity":
                    jacobian[..., column] = by_tilt[..., int(target)]
                case "cord":
                    jacobian[..., column] = by_cord
                case "alignment" if target in suite.parameter_names:
                    jacobian[..., column] = by_alignment[..., suite.parameter_names.index(target)]
        return jacobian


def registered(suite: SensorSuite) -> Floats:
    """Tell which rows of a suite rest on the laboratory's registration, 1 or 0, shape (rows,)."""
    flags = np.zeros(suite.size)
    for measurement in suite.measurements:
        flags[suite.slices[measurement.name]] = measurement.registration is not None
    return flags


def lever(suite: SensorSuite, innovation: Floats) -> Floats:
    """Give what a turn of the registration moves measured points more than predicted ones.

    A turn w moves a measured point y by w x y and a predicted one, p = y - innovation, by w x p.

    Returns:
        Per turn and shift as ``rigid_motion`` has them, shape (nodes, rows, 6).
    """
    more = np.zeros((*innovation.shape, 6))
    for measurement in suite.measurements:
        if isinstance(measurement, SectionPose | Marker):
            first = suite.slices[measurement.name].start
            more[:, first : first + 3, 3:] = skew(innovation[:, first : first + 3])
    return more


def by_azimuth(by_load: Floats, pulls: Floats) -> Floats:
    """Differentiate readings by a rotation of all pulls about z, shape (nodes, rows).

    Args:
        by_load: Readings per unit of each load, shape (nodes, rows, loads).
        pulls: Forces, three components a section, shape (nodes, loads).
    """
    if not pulls.size:
        return np.zeros(by_load.shape[:2])
    forces = pulls.reshape(len(pulls), -1, 3)
    change = np.cross([0.0, 0.0, 1.0], forces).reshape(pulls.shape)
    moved: Floats = (by_load @ change[..., None])[..., 0]
    return moved


def rigid_motion(frames: Frames) -> Floats:
    """Give the stacked twists of the sections in a rigid motion (v, w) of all, shape (..., 6 sections, 6)."""
    sections = frames.positions.shape[-2]
    motion = np.zeros((*frames.positions.shape[:-2], sections, 6, 6))
    motion[...] = np.eye(6)
    motion[..., :3, 3:] = -skew(frames.positions)
    return motion.reshape(*frames.positions.shape[:-2], 6 * sections, 6)

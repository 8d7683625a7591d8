"""Pose and external force over a recording, sample by sample, with their uncertainty."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.augmented import TrackingEstimator, estimator_of
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.dynamics import MovingForces
from softarm.estimator.errors import InputError
from softarm.estimator.fem import FiniteElementState
from softarm.estimator.inverse import ArmEstimate, Estimator, LoadProcess, TrackerSettings
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.sensing import ActuationMap, ModelError, Registration
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.simulation import section_loads
from softarm.estimator.specimen import Specimen

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

FORCE_SIGMA = 1.0  # N; long-run spread of an unknown force, the range of the paper's experiments
MOMENT_SIGMA = 0.1  # N m
STATUSES = ("converged", "iterations_exhausted", "diverged")
SHOWN = 6
PATIENCE_S = 40.0
"""Seconds of failed searches in a row, after which the rest of a run is left out."""


@dataclass
class Waypoints(Generic[State]):
    """States along a run, from which estimates at the same samples on other sensors begin.

    Args:
        loads: Names of the loads of the model that found them.
        solutions: State and inputs of each sample, ``None`` where the search diverged; empty until a run was
            followed.
    """

    loads: tuple[str, ...] = ()
    solutions: list[tuple[State, Inputs] | None] = field(default_factory=list)

    def at(self, index: int, loads: Sequence[Load]) -> tuple[State, Inputs] | None:
        """Return a sample's state with the inputs of a model that has other unknown loads as well."""
        if index >= len(self.solutions) or (solution := self.solutions[index]) is None:
            return None
        state, inputs = solution
        values = dict(zip(self.loads, inputs.loads.tolist(), strict=True))
        amplitudes = np.array([values.get(load.name, 0.0) for load in loads])
        start = Inputs(inputs.pressures, amplitudes, inputs.gravity)
        if isinstance(state, FiniteElementState):
            state = replace(state, inputs=start)
        return state, start


@dataclass(frozen=True)
class Track(Generic[State]):
    """Estimates over time; NaN where a search diverged.

    Args:
        run: What was recorded, at the times of the estimates.
        sections: Names of the sections.
        loads: The loads that were estimated.
        forces: Their amplitudes without the arm's inertia [N or N m], shape (samples, loads).
        force_covariance: Shape (samples, loads, loads).
        pressures: Pressures in the chambers [Pa], shape (samples, chambers).
        frames: Frames of the sections in the base frame.
        frame_std: Standard deviation of each section's translation [m] and rotation [rad] in base axes,
            shape (samples, sections, 6).
        residuals: Measured minus estimated of the whole suite, shape (samples, rows).
        misfit: Weighted sum of squared residuals; chi-square where the model is right, shape (samples,).
        freedom: Its expectation, shape (samples,).
        status: Index into ``STATUSES``, shape (samples,).
        shown: Index and state of a few samples, for pictures.
        statement: What was estimated from what, and what cannot be seen.
        given_up: Number of samples at the end that were not tried, after failed searches for too long.
    """

    run: CalibrationRun
    sections: tuple[str, ...]
    loads: tuple[Load, ...]
    forces: Floats
    force_covariance: Floats
    pressures: Floats
    frames: Frames
    frame_std: Floats
    residuals: Floats
    misfit: Floats
    freedom: Floats
    status: NDArray[np.int64]
    shown: tuple[tuple[int, State], ...]
    statement: str
    given_up: int = 0

    @property
    def force_std(self) -> Floats:
        """Standard deviation of each load, shape (samples, loads)."""
        return np.sqrt(np.diagonal(self.force_covariance, axis1=1, axis2=2))


def track(
    model: ArmModel[State, Step],
    specimen: Specimen,
    run: CalibrationRun,
    advance: Callable[[float], None] = lambda _: None,
    fast_model: ArmModel[Any, Any] | None = None,
    waypoints: Waypoints[State] | None = None,
    tared: Flags | None = None,
) -> Track[State]:
    """Estimate loads and frames at every sample of a run, each on its own but for the arm's inertia.

    Recorded pressures count as readings with their noise; the loads as unknown with a spread of
    ``FORCE_SIGMA``.

    Args:
        model: Model of the specimen whose loads are the unknown ones.
        specimen: The robot.
        run: What was recorded, arranged for the model's sections.
        advance: Called with 1 after each sample.
        fast_model: A fast model with the same loads; its solution is the start where no better one is known.
        waypoints: States of the same samples to begin at; filled where it is empty.
        tared: Samples from which the forces afterwards count; none where it is left out, shape (samples,).
    """
    estimator = _estimator(model, specimen, run, fast_model)
    gravity = np.array(specimen.gravity_m_s2)
    chosen = {int(k) for k in np.linspace(0, len(run.time) - 1, SHOWN)}
    shown: list[tuple[int, State]] = []
    estimates = _blank(model, run)
    moving = MovingForces.of(specimen, tuple(model.sections), model.loads, run.suite)
    statement = ""
    waypoints = waypoints or Waypoints()
    solved = bool(waypoints.solutions)
    waypoints.loads = waypoints.loads or tuple(load.name for load in model.loads)
    in_vain_s, given_up = 0.0, 0
    for index, (time, readings, pressures) in enumerate(
        zip(run.time, run.readings, run.pressures, strict=True)
    ):
        if in_vain_s > PATIENCE_S:
            given_up = len(run.time) - index
            waypoints.solutions += [] if solved else [None] * given_up
            advance(given_up)
            break
        begin_near(estimator, waypoints, index, model.loads)
        began = monotonic()
        estimate = estimator.update(float(time), readings, pressures, gravity)
        if estimate.status == "diverged" and index and isinstance(estimator, Estimator):
            # A valve that opens between two samples: the last state is farther away than rest.
            estimator.reset()
            estimate = estimator.update(float(time), readings, pressures, gravity)
        in_vain_s = in_vain_s + monotonic() - began if estimate.status == "diverged" else 0.0
        _put(estimates, index, estimate, *moving.update(float(time), readings, estimate))
        if tared is not None and tared[index]:
            moving.tare()
        if not solved:
            lost = estimate.status == "diverged"
            waypoints.solutions.append(None if lost else (estimate.state, estimate.inputs))
        if index in chosen and estimate.status != "diverged":
            shown.append((index, estimate.state))
        if not statement and estimate.converged:
            statement = estimate.observability.statement
        advance(1)
    return replace(estimates, shown=tuple(shown), statement=statement, given_up=given_up)


def begin_near(
    estimator: TrackingEstimator[State], waypoints: Waypoints[State], index: int, loads: Sequence[Load]
) -> None:
    """Start an estimator without physics at a waypoint, where there is one."""
    start = waypoints.at(index, loads)
    if start is not None and isinstance(estimator, Estimator):
        estimator.begin_at(*start)


def _estimator(
    model: ArmModel[State, Step],
    specimen: Specimen,
    run: CalibrationRun,
    fast_model: ArmModel[Any, Any] | None,
) -> TrackingEstimator[State]:
    """Make the estimator; physics of the specimen needs the model under the wrenches of its sections."""
    followed = model
    if specimen.physics:
        with_loads = getattr(model, "with_loads", None)
        if with_loads is None:
            raise InputError("physics", "this model takes no other loads", "estimate with a model that does")
        followed = with_loads(section_loads(model.sections))
    return estimator_of(
        specimen,
        followed,
        model.loads,
        run.suite,
        settings(model.loads, specimen, run),
        pressures_measured="commanded" not in run.pressure_source,
        fast_model=fast_model,
        recorded=(run.time, run.pressures),
    )


def settings(loads: Sequence[Load], specimen: Specimen, run: CalibrationRun) -> TrackerSettings:
    """Choose what the estimator assumes of a run: noise of its pressures, spread of its loads."""
    sigma = [FORCE_SIGMA if load.kind == "force" else MOMENT_SIGMA for load in loads]
    return TrackerSettings(
        process=LoadProcess(np.array(sigma), time_constant=0.0),
        actuation=actuation(specimen, run),
        pressure_limits=np.array(specimen.pressure_limits),
        model_error=ModelError.of(
            specimen.calibration.scatter, specimen.calibration.force_ratio, specimen.calibration.force_error
        ),
    )


def actuation(specimen: Specimen, run: CalibrationRun) -> ActuationMap:
    """Return the map from recorded to chamber pressures; nominal pressures are noisier than measured ones.

    The error of a nominal pressure is relative to that chamber's own: one that stays vented has none.
    """
    sections = tuple(section.name for section in specimen.sections)
    calibrated = SpecimenSensors(specimen, sections, Registration()).actuation()
    if "commanded" not in run.pressure_source:
        return calibrated
    highest = np.nanmax(run.pressures, axis=0, initial=0.0)
    nominal = specimen.noise.nominal_pressure_relative * highest
    return replace(calibrated, sigma=np.maximum(calibrated.sigma, nominal))


def _blank(model: ArmModel[State, Step], run: CalibrationRun) -> Track[State]:
    """Make the track of a run of which no sample has been estimated yet."""
    count, loads, sections = len(run.time), len(model.loads), len(model.sections)

    def empty(*shape: int) -> Floats:
        return np.full((count, *shape), np.nan)

    return Track(
        run,
        tuple(model.sections),
        tuple(model.loads),
        forces=empty(loads),
        force_covariance=empty(loads, loads),
        pressures=empty(model.chambers),
        frames=Frames(empty(sections, 3), empty(sections, 3, 3)),
        frame_std=empty(sections, 6),
        residuals=empty(run.suite.size),
        misfit=empty(),
        freedom=empty(),
        status=np.full(count, STATUSES.index("diverged")),
        shown=(),
        statement="",
    )


def _put(
    track: Track[State], index: int, estimate: ArmEstimate[State], forces: Floats, covariance: Floats
) -> None:
    """Write the estimate of a sample into the arrays of a track."""
    track.status[index] = STATUSES.index(estimate.status)
    if estimate.status == "diverged":
        return
    track.forces[index] = forces
    track.force_covariance[index] = covariance
    track.pressures[index] = estimate.inputs.pressures
    track.frames.positions[index] = estimate.frames.positions
    track.frames.rotations[index] = estimate.frames.rotations
    track.frame_std[index] = estimate.frame_deviations.reshape(-1, 6)
    track.residuals[index] = np.concatenate(list(estimate.residuals.values()))
    track.misfit[index] = estimate.normalised_innovation_squared
    track.freedom[index] = estimate.degrees_of_freedom

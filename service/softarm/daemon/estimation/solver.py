"""What runs in the estimator's process: model and sensors of a specimen, one request at a time."""

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from softarm.common.rods import known_trusted_rod, trusted_rod
from softarm.daemon.config import ControlSettings, SensorSettings
from softarm.daemon.estimation.holding import HoldSolver
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult, HoldAnswer
from softarm.daemon.estimation.rod_check import RodCheck
from softarm.daemon.estimation.worker import BuiltSolver
from softarm.daemon.surface import drawn_surface
from softarm.estimator.arm import build_arm, default_loads
from softarm.estimator.arrays import Floats
from softarm.estimator.augmented import AugmentedEstimator, TrackingEstimator, estimator_of
from softarm.estimator.dynamics import MovingForces
from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.tracking import BackgroundFactorisation, TrackingModel
from softarm.estimator.inverse import (
    ArmEstimate,
    BackgroundSolver,
    ContactPlace,
    ContactProfile,
    Estimator,
    FallbackEstimator,
    LoadProcess,
    Tolerances,
    TrackerSettings,
)
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.rod.skin import skin
from softarm.estimator.rotations import from_quaternions, to_quaternions
from softarm.estimator.sensing import ModelError, Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors, mounted_base
from softarm.estimator.simulation import section_loads
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import stretched

WARM_UP_PRESSURE_PA = 1000.0
WARM_UP_S = (0.0, 0.15, 0.3, 0.45, 0.46, 0.47)
"""Times [s] of the instants that warm a solver up. The first has no readings; the finite elements begin with
the third where a rod answers for them. The filter of the forces begins anew after a pause in which the arm
may have swung, so the last follow at the pace of a live arm."""
LIVE = Tolerances(
    step=1e-4,
    residual=1e-4,
    iterations=20,
    radius=0.3,
    rejections=2,
    forecast=30.0,
    solves_after_rejection=False,
)
"""No instant waits for a long search: the next one continues it. Where an instant comes late, the arm has
moved far: the search goes in short steps and judges none before the balance is near. It repeats a step that
went wrong from where that began, for a solve of the model takes as long as thirty steps."""
BRIEF = replace(LIVE, iterations=6, rejections=0)
"""Where the rod answers for the finite elements at once, a search of twice the usual length is abandoned."""
PREPARED = 1e-3
"""Step in units of the inputs' scale that an estimate on the rod may leave to the next: 20 Pa and 0.5 mN."""
SOLVES = 12
"""Linear solves in one search for an equilibrium: about a quarter of a second."""
PLACES = 12
"""Candidate heights of a push, from the clamp to the tip."""
INSIDE_M = 1e-3
OBSERVED_EVERY_S = 0.1
"""What the readings do not determine is analysed so often; it changes slowly."""


@dataclass(frozen=True)
class SolverSettings:
    """What the solver is built from; small and picklable.

    Args:
        sensors: Sensors in the order of the requests' readings, gauges left out.
        control: Model and the loads' process.
    """

    specimen: Specimen
    sensors: tuple[SensorSettings, ...]
    control: ControlSettings

    def __call__(self) -> BuiltSolver:
        """Build the solver and warm it up; it reports the surface that clients draw."""
        solver = Solver(self)
        return BuiltSolver(solver, solver.surface, solver.finish, solver.prepare)


def build_suite(
    specimen: Specimen, sections: tuple[str, ...], entries: Sequence[SensorSettings]
) -> SensorSuite:
    """Make the sensor suite of a configuration; poses arrive in the base frame."""
    sensors = SpecimenSensors(specimen, sections, mounted_base(specimen))
    kinds = {"pose": "frame"}
    return SensorSuite(tuple(sensors.named(f"{kinds.get(e.kind, e.kind)}_{e.section}") for e in entries))


class Solver:
    """Answers requests; it keeps the estimator's memory."""

    def __init__(self, settings: SolverSettings) -> None:
        specimen = settings.specimen
        self._model: FiniteElementModel = bounded(
            build_arm(specimen, default_loads(specimen, settings.control.forces_on))
        )
        drawn = drawn_surface(self._model.mesh)
        self._drawn = drawn.nodes
        self.surface = drawn.message(self._model.mesh)
        self._suite = build_suite(specimen, self._model.sections, settings.sensors)
        self._sensors = SpecimenSensors(specimen, self._model.sections, Registration())
        self._actuation = self._sensors.actuation()
        self._limits = np.array(specimen.pressure_limits)
        sigma = np.full(len(self._model.loads), settings.control.load_std_n)
        process = LoadProcess(sigma, settings.control.load_time_constant_s)
        calibration = specimen.calibration
        error = ModelError.of(calibration.scatter, calibration.force_ratio, calibration.force_error)
        self._on_rod = settings.control.model == "rod"
        self._rod = trusted_rod(specimen) if self._on_rod else known_trusted_rod(specimen)
        falls_back = self._rod is not None and not self._on_rod and not specimen.physics
        tolerances = replace(LIVE, step=PREPARED) if self._on_rod else BRIEF if falls_back else LIVE
        tracker = TrackerSettings(
            process, self._actuation, self._limits, model_error=error, tolerances=tolerances
        )
        self._threads = ExitStack()
        self._check: RodCheck | None = None
        if self._on_rod:
            self._check = self._threads.enter_context(RodCheck(stretched(self._model, specimen)))
        follower: TrackingEstimator[Any] = estimator_of(
            specimen, self._followed(specimen), self._model.loads, self._suite, tracker,
            pressures_measured=True,
        )  # fmt: skip
        self._background_solver: BackgroundSolver[Any] | None = None
        if falls_back and self._rod is not None and isinstance(follower, Estimator):
            self._background_solver = self._threads.enter_context(
                BackgroundSolver(follower.model, LIVE.radius)
            )
            rod: Any = stretched(self._rod.with_loads(self._model.loads), specimen)
            fast = Estimator(rod, self._suite, replace(tracker, tolerances=LIVE))
            follower = FallbackEstimator(follower, fast, self._background_solver)
        self._estimator = follower
        self._moving = MovingForces.of(specimen, self._model.sections, self._model.loads, self._suite)
        self._tared = np.zeros(len(self._model.loads))
        pressures_before_effects = (
            follower.pressures_before_effects if isinstance(follower, AugmentedEstimator) else np.asarray
        )
        self._held_arm = HoldSolver(self._suite, self._actuation, self._limits, pressures_before_effects)
        self._profile = ContactProfile(_heights(specimen), passes=1)
        every = (*self._model.loads, *self._profile.loads)
        models: dict[str, Any] = {"fem": self._model} | ({"rod": self._rod} if self._rod else {})
        self._pushed = {name: stretched(model.with_loads(every), specimen) for name, model in models.items()}
        self._unobservable: tuple[float, tuple[str, ...], tuple[str, ...]] = (-np.inf, (), ())
        self._unanalysed: tuple[EstimationRequest, ArmEstimate[Any]] | None = None
        self._warm_up(np.array(specimen.gravity_m_s2))

    def _followed(self, specimen: Specimen) -> Any:
        """Return the model of the estimates."""
        loads = section_loads(self._model.sections) if specimen.physics else self._model.loads
        if self._on_rod and self._rod is not None:
            return self._rod.with_loads(loads)
        followed = self._model.with_loads(loads) if specimen.physics else self._model
        return TrackingModel(followed, self._threads.enter_context(BackgroundFactorisation(followed)))

    @property
    def _solved_by(self) -> Literal["fem", "rod"]:
        """The model of the last estimate."""
        fallen_back = isinstance(self._estimator, FallbackEstimator) and self._estimator.lost
        return "rod" if self._on_rod or fallen_back else "fem"

    def close(self) -> None:
        """End the threads of this solver; a process that ends with it needs no call."""
        self._threads.close()

    def _warm_up(self, gravity: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        """Compile and factor once, so that the first live request is as fast as the rest."""
        readings = self._suite.stack({})
        pressures = np.full(self._model.chambers, WARM_UP_PRESSURE_PA)
        for time_s in WARM_UP_S:
            result = self(EstimationRequest(time_s, 0, readings, pressures, gravity, with_hold=True))
            readings = self._suite.predict(Frames(result.positions, from_quaternions(result.quaternions)))
            if self._background_solver is not None:
                self._background_solver.wait()  # so that both models are warmed up
        # What stays is compiled code and the factor; the forces of made-up readings are forgotten.
        self._estimator.reset()
        self._moving.reset()

    def __call__(self, request: EstimationRequest) -> EstimationResult:
        """Estimate at one instant."""
        begin = time.perf_counter()
        estimate = self._estimator.update(
            request.time_s, request.readings, request.pressures, request.gravity
        )
        if self._check is not None and estimate.converged:
            self._check.offer(request.time_s, estimate.inputs, estimate.frames)
        if request.tare is not None and not np.array_equal(request.tare, self._tared):
            self._tared = request.tare
            self._moving.tare()
        loads, covariance = self._moving.update(request.time_s, request.readings, estimate)
        hold = self._held(request, estimate)
        contact = self._contact(request, estimate) if request.with_contact else None
        return EstimationResult(
            request=request,
            converged=estimate.converged,
            model=self._solved_by,
            loads=loads,
            load_covariance=covariance,
            positions=estimate.frames.positions,
            quaternions=to_quaternions(estimate.frames.rotations),
            frame_std=estimate.frame_deviations.reshape(-1, 6),
            innovation_squared=estimate.normalised_innovation_squared,
            degrees_of_freedom=estimate.degrees_of_freedom,
            sensor_innovations=self._innovations(request, estimate),
            unobservable=self._unobservable_directions(request, estimate),
            hold=hold,
            contact=contact,
            nodes=self._nodes(estimate) if request.with_mesh else None,
            solve_s=time.perf_counter() - begin,
            rod_off_rad=None if self._check is None else self._check.departure,
        )

    def _unobservable_directions(
        self, request: EstimationRequest, estimate: ArmEstimate[Any]
    ) -> tuple[str, ...]:
        """Return what these sensors do not determine; an old answer serves while they are the same."""
        since_s, sensors, directions = self._unobservable
        if not np.isfinite(estimate.motion).all():
            return ()
        # A request earlier than the last analysis belongs to another run.
        if sensors != request.used or request.time_s < since_s:
            return self._analyse(request, estimate)
        if request.time_s >= since_s + OBSERVED_EVERY_S:
            self._unanalysed = request, estimate
        return directions

    def _analyse(self, request: EstimationRequest, estimate: ArmEstimate[Any]) -> tuple[str, ...]:
        directions = estimate.unobservable_directions
        self._unobservable = request.time_s, request.used, directions
        return directions

    def finish(self) -> None:
        """Analyse anew what the readings do not determine, where that is due: the next answer needs it."""
        if self._unanalysed is not None:
            self._analyse(*self._unanalysed)
            self._unanalysed = None

    def prepare(self) -> None:
        """Linearise the rod at the last estimate: the next one has less to do."""
        if self._on_rod and isinstance(self._estimator, Estimator):
            self._estimator.prepare()

    def _innovations(self, request: EstimationRequest, estimate: ArmEstimate[Any]) -> dict[str, float]:
        innovations = {}
        for sensor in self._estimator.suite_at(request.pressures).measurements:
            reading = request.readings[self._suite.reading_slices[sensor.name]]
            residual = estimate.residuals[sensor.name]
            ratio = float((residual**2 / sensor.covariance(reading).diagonal()).sum()) / sensor.size
            if math.isfinite(ratio):
                innovations[sensor.name] = math.sqrt(ratio)
        return innovations

    def _held(self, request: EstimationRequest, estimate: ArmEstimate[Any]) -> HoldAnswer | None:
        """Compute the pressures that hold the pose while they are requested."""
        if not request.with_hold:
            return None
        return self._held_arm.answer(estimate, self._tare(request), request.target)

    def _tare(self, request: EstimationRequest) -> Floats:
        return np.zeros(len(self._model.loads)) if request.tare is None else request.tare

    def _contact(self, request: EstimationRequest, estimate: ArmEstimate[Any]) -> ContactPlace | None:
        """Locate the contact force that the estimated loads amount to."""
        if not estimate.converged:
            return None
        inputs = estimate.inputs
        loads = np.concatenate([inputs.loads, np.zeros(len(self._profile.loads))])
        extended = Inputs(inputs.pressures, loads, inputs.gravity)
        state, model = estimate.state, self._solved_by
        if model == "fem":
            state = FiniteElementState(state.displacement, extended)
        suite = self._estimator.suite_at(request.pressures)
        return self._profile.place(
            self._pushed[model], state, suite, request.readings, estimate, self._tare(request)
        )

    def _nodes(self, estimate: ArmEstimate[Any]) -> NDArray[np.float32]:
        """Return position [m] and von Mises stress [Pa] of the surface's nodes, shape (nodes, 4).

        The rod has no stress: it is 0 there.
        """
        if self._rod is not None and self._solved_by == "rod":
            positions = skin(self._model.mesh.points[self._drawn], self._rod.chain, estimate.state)
            return np.column_stack([positions, np.zeros(len(positions))]).astype(np.float32)
        positions = self._model.mesh.points + estimate.state.displacement
        state = FiniteElementState(estimate.state.displacement, estimate.inputs)
        _, stress = self._model.energy_and_stress(state)
        nodes = np.zeros((len(positions), 4), dtype=np.float32)
        nodes[:, :3] = positions
        count = np.zeros(len(positions))
        first = 0
        for block in self._model.mesh.blocks:
            on_elements = stress[first : first + len(block.connectivity)]
            first += len(block.connectivity)
            np.add.at(nodes[:, 3], block.connectivity, on_elements[:, None].astype(np.float32))
            np.add.at(count, block.connectivity, 1.0)
        nodes[:, 3] /= np.maximum(count, 1.0)
        return nodes[self._drawn]


def bounded(model: FiniteElementModel) -> FiniteElementModel:
    """Return a model whose searches for an equilibrium end in time for a live service."""
    return replace(model, settings=replace(model.settings, total_iterations=SOLVES, descent=SOLVES))


def _heights(specimen: Specimen) -> NDArray[np.float64]:
    """Return candidate heights of a push [m], from above the clamp to the tip."""
    tip = max(section.to_m for section in specimen.sections)
    start = specimen.clamp.up_to_m + (tip - specimen.clamp.up_to_m) / PLACES
    return np.linspace(start, tip - INSIDE_M, PLACES)

"""The estimator that follows an arm through time, for the live service and for recordings alike."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.estimate import ArmEstimate, Problem
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.minimise import Linearised, Tolerances
from softarm.estimator.inverse.objectives import PressureReadings, Prior, SensorObjective
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation, Load
from softarm.estimator.sensing import ActuationMap, ModelError, SensorSuite, widened
from softarm.estimator.sensing.model_error import Condition
from softarm.estimator.small_matrices import invert


@dataclass(frozen=True)
class LoadProcess:
    """Loads that wander about zero (an Ornstein-Uhlenbeck process).

    Over dt, with a = exp(-dt / time_constant), mean' = a mean and covariance' = a^2 covariance +
    (1 - a^2) sigma^2. Over short times this is a random walk of variance 2 sigma^2 dt / time_constant; over
    long ones only ``sigma`` remains. Thus a sensor that falls silent widens the covariance without a jump.

    Args:
        sigma: Long-run standard deviation of each load [N or N m], shape (loads,).
        time_constant: [s]; 0 makes every instant independent of the last.
    """

    sigma: Floats
    time_constant: float

    def start(self) -> tuple[Floats, Floats]:
        """Return mean and covariance before any reading."""
        return np.zeros(len(self.sigma)), np.diag(self.sigma**2)

    def predict(self, mean: Floats, covariance: Floats, duration: float) -> tuple[Floats, Floats]:
        """Carry mean, shape (loads,), and covariance, shape (loads, loads), over a duration [s]."""
        kept = np.exp(-max(duration, 0.0) / self.time_constant) if self.time_constant > 0 else 0.0
        return kept * mean, kept**2 * covariance + (1.0 - kept**2) * np.diag(self.sigma**2)


State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


PRESSURE_DRIFT = 5e3
"""How fast the pressure of a chamber whose sensor is silent may wander [Pa/sqrt(s)]."""
RETRIES = 2
"""Searches in a row that may fail before the next one begins at rest, slowest without a fast model."""


@dataclass(frozen=True)
class TrackerSettings:
    """What the tracking estimator assumes.

    Args:
        process: How loads change.
        actuation: From measured to chamber pressures, with the noise of the pressure sensors.
        pressure_limits: Largest gauge pressure of each chamber [Pa], shape (chambers,); bounds a chamber
            whose pressure sensor is silent.
        model_error: What the calibrated model leaves unexplained; it widens the sensors' noise.
        tolerances: When a search stops.
    """

    process: LoadProcess
    actuation: ActuationMap
    pressure_limits: Floats
    model_error: ModelError = field(default_factory=ModelError)
    tolerances: Tolerances | None = None


@dataclass(frozen=True)
class _Memory(Generic[State]):
    """What is kept from one instant to the next."""

    time: float
    state: State
    inputs: Inputs
    covariance: Floats
    last: Linearised[State] | None = None


@dataclass(frozen=True)
class _Accuracy:
    """The errors that a calibration states for one condition of the arm.

    Args:
        suite: The sensors, as noisy as they and the model are together.
        force_ratios: Error over deviation of the estimated force of each load, shape (loads,).
        relative_variances: Variance of each load beside that, over the square of each load of its kind on its
            section: an error that grows with a force points in any direction; shape (loads, loads).
    """

    suite: SensorSuite
    force_ratios: Floats
    relative_variances: Floats

    @classmethod
    def of(cls, condition: Condition, suite: SensorSuite, loads: Sequence[Load]) -> "_Accuracy":
        """Look up what holds for loads on their sections."""
        places = [(load.section, load.kind) for load in loads]
        together = np.array([[place == other for other in places] for place in places], dtype=np.float64)
        errors = np.array([condition.relative_error(load.section) for load in loads])
        return cls(
            widened(suite, condition.scatter),
            np.array([condition.load_ratio(load) for load in loads]),
            errors[:, None] ** 2 * together.reshape(len(loads), len(loads)),
        )


class Estimator(Generic[State, Step]):
    """Estimate loads, pressures and frames from readings in the order of their time.

    It keeps the last state, inputs and covariance; everything it calls is pure. A search that fails leaves
    them as they were. The next one sets out from them with a fresh linearisation, or after ``RETRIES`` more
    failures, and at once where there is a fast model, from the beginning.

    Args:
        model: Model of the arm.
        suite: The sensors.
        settings: What it assumes.
        fast_model: A fast model with the same chambers and loads, at whose answer a fresh search begins.
    """

    def __init__(
        self,
        model: ArmModel[State, Step],
        suite: SensorSuite,
        settings: TrackerSettings,
        fast_model: ArmModel[Any, Any] | None = None,
    ) -> None:
        self._fast_model = fast_model
        self._retries = RETRIES if fast_model is None else 0
        self._model = model
        # Once and for all, so that no suite is built at an instant.
        self._conditions = {c: _Accuracy.of(c, suite, model.loads) for c in settings.model_error.conditions}
        self._settings = settings
        self._unknowns = Unknowns.of(model.chambers, model.loads)
        self._free = InputBounds.free(self._unknowns.size)
        self._unknown_pressures = np.diag(settings.pressure_limits**2)
        self._memory: _Memory[State] | None = None
        self._solved: tuple[Problem, ArmEstimate[State]] | None = None
        self._failures = 0

    @property
    def model(self) -> ArmModel[State, Step]:
        """The model it runs on."""
        return self._model

    def suite_at(self, pressures: Floats) -> SensorSuite:
        """Return the sensors, as noisy as they and the model are together at measured pressures [Pa]."""
        return self._conditions[self._settings.model_error.at(pressures)].suite

    def follow(self, model: ArmModel[State, Step]) -> None:
        """Continue with another model of the same states and inputs, such as one under known loads."""
        self._model = model

    def reset(self) -> None:
        """Forget the past."""
        self._memory = self._solved = None
        self._failures = 0

    def begin_at(self, state: State, inputs: Inputs) -> None:
        """Begin the next search at an equilibrium from another source, such as other sensors."""
        # That determines the pose, not what holds it: pressures and loads are as open as at the very start.
        variance = np.concatenate([self._settings.pressure_limits**2, self._settings.process.sigma**2])
        time = -np.inf if self._memory is None else self._memory.time
        self._memory, self._solved = _Memory(time, state, inputs, np.diag(variance)), None
        self._failures = 0

    def update(self, time: float, readings: Floats, pressures: Floats, gravity: Floats) -> ArmEstimate[State]:
        """Estimate at an instant.

        Args:
            time: Time of the readings [s], not before the last one.
            readings: Stacked readings, NaN where absent, shape (readings,).
            pressures: Measured gauge pressures [Pa], NaN where lost, shape (chambers,).
            gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
        """
        acting = self._settings.actuation.to_chamber(pressures)
        prior, guess = self._predict(time, acting, gravity)
        accuracy = self._conditions[self._settings.model_error.at(pressures)]
        problem = self._problem(accuracy, readings, acting, prior, gravity)
        # After a failure not even the last linearisation is trusted: it may be what misled the search.
        warm_start = None if self._memory is None or self._failures else self._memory.last
        start = self._start(problem, guess)
        estimate = problem.solve(self._model, start, self._settings.tolerances, warm_start)
        if estimate.status == "diverged" or not np.isfinite(estimate.vector).all():
            self._failures += 1
            self._solved = None
        else:
            self._failures, self._solved = 0, (problem, estimate)
            covariance, last = estimate.covariance, estimate.last
            self._memory = _Memory(time, estimate.state, estimate.inputs, covariance, last)
        return estimate

    def prepare(self) -> None:
        """Linearise at the last estimate, while nothing waits for the next one.

        That one then takes a single step where the arm has moved little. It needs a model whose
        linearisations are in equilibrium.
        """
        if self._solved is not None and self._memory is not None:
            problem, estimate = self._solved
            self._memory = replace(self._memory, last=problem.prepared(self._model, estimate))
            self._solved = None

    def _predict(self, time: float, acting: Floats, gravity: Floats) -> tuple[Prior, Inputs]:
        """Carry the last estimate to this instant: the prior, and the inputs to begin the search with."""
        chambers, process, memory = self._unknowns.chambers, self._settings.process, self._memory
        mean = np.zeros(self._unknowns.size)
        information = np.zeros((len(mean), len(mean)))
        if memory is None:
            before, elapsed = self._unknown_pressures, 0.0
            mean[chambers:], loads = process.start()
        else:
            before, elapsed = memory.covariance, time - memory.time
            mean[:chambers] = memory.inputs.pressures
            mean[chambers:], loads = process.predict(
                memory.inputs.loads, before[chambers:, chambers:], elapsed
            )
        sigma = self._settings.actuation.chamber_sigma
        _inform(acting, before, sigma, max(elapsed, 0.0), loads, information)
        if memory is not None and self._failures <= self._retries:
            # The state is in equilibrium with the last inputs: the first step carries both to the new ones.
            return Prior(mean, information), memory.inputs
        unloaded = np.zeros(len(mean) - chambers)
        return Prior(mean, information), Inputs(
            np.where(np.isfinite(acting), acting, mean[:chambers]), unloaded, gravity
        )

    def _problem(
        self, accuracy: _Accuracy, readings: Floats, acting: Floats, prior: Prior, gravity: Floats
    ) -> Problem:
        limits, lost = self._free, np.flatnonzero(~np.isfinite(acting))
        if len(lost):
            limits = limits.bound(lost, 0.0, self._settings.pressure_limits[lost])
        objectives = (
            SensorObjective(accuracy.suite, readings),
            prior,
            PressureReadings(acting, self._settings.actuation.chamber_sigma),
        )
        return Problem(
            self._unknowns, accuracy.suite, objectives, limits, gravity,
            accuracy.force_ratios, accuracy.relative_variances,
        )  # fmt: skip

    def _start(self, problem: Problem, guess: Inputs) -> tuple[State, Inputs]:
        if self._memory is not None and self._failures <= self._retries:
            state = self._memory.state
            return self._model.refreshed(state) if self._failures else state, guess
        fast_inputs = self._fast_solution(problem, guess)
        if fast_inputs is not None:
            state, converged = self._model.solve(fast_inputs, self._model.rest())
            if converged:
                return state, fast_inputs
        state, _ = self._model.solve(guess, self._model.rest())
        return state, guess

    def _fast_solution(self, problem: Problem, guess: Inputs) -> Inputs | None:
        """Return the inputs that solve the problem on the fast model, None where it finds none."""
        if self._fast_model is None:
            return None
        state, _ = self._fast_model.solve(guess, self._fast_model.rest())
        estimate = problem.solve(self._fast_model, (state, guess), self._settings.tolerances)
        return estimate.inputs if estimate.converged else None


@njit(cache=True, nogil=True)
def _inform(
    acting: Floats, covariance: Floats, sigma: Floats, elapsed: float, loads: Floats, information: Floats
) -> None:
    """Fill the information of the prior: of the loads, and of the pressures whose sensors are silent.

    Args:
        acting: Chamber pressures [Pa], NaN where not measured, shape (chambers,).
        covariance: Of the pressures at the last instant, and perhaps of more, (chambers or more, likewise).
        sigma: Standard deviation of a measured pressure [Pa], shape (chambers,).
        elapsed: Time since then [s].
        loads: Covariance of the loads, shape (loads, loads).
        information: Zeros, filled, shape (inputs, inputs).
    """
    chambers = len(acting)
    invert(loads, information[chambers:, chambers:])
    for k in range(chambers):
        if not np.isfinite(acting[k]):
            # At a bound the covariance is zero, yet the pressure may leave it at once.
            least = max(covariance[k, k], sigma[k] * sigma[k])
            information[k, k] = 1.0 / (least + PRESSURE_DRIFT**2 * elapsed)

"""The inverse problem and its answer: inputs and frames with their covariance, and how far to trust them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numba import njit

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.minimise import Linearised, Minimum, Tolerances, linearise_at, minimise
from softarm.estimator.inverse.objectives import PRESSURES, Objective, WeightedRows
from softarm.estimator.inverse.observability import Observability, analyse
from softarm.estimator.inverse.program import sum_of
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.small_matrices import invert

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


@dataclass(frozen=True)
class ArmEstimate(Minimum[State]):
    """Inputs, state and frames that meet the readings best.

    Args:
        unknowns: Names and scales of the inputs.
        inputs: Pressures [Pa], loads [N or N m] and gravity [m/s2].
        covariance: Covariance of pressures, then loads; zero where held, and conditional on the bounds
            that are reached, shape (inputs, inputs).
        limits: The bounds.
        residuals: Measured minus estimated by sensor, NaN where absent.
        force_ratios: Factors on the deviations of the loads beside what the rows' noise makes of them, shape
            (loads,).
        relative_variances: Of the loads beside that, by the square of each load, shape (loads, loads).
    """

    unknowns: Unknowns
    inputs: Inputs
    covariance: Floats
    limits: InputBounds
    residuals: Mapping[str, Floats]
    force_ratios: Floats | float = 1.0
    relative_variances: Floats | float = 0.0

    @property
    def converged(self) -> bool:
        """Whether the search converged."""
        return self.status == "converged"

    @property
    def measured_pressures(self) -> Floats:
        """Acting pressures by measurement, estimated where there is none [Pa], shape (chambers,)."""
        pressures = self.inputs.pressures.copy()
        for row in self.rows:
            if row.name == PRESSURES:
                pressures[row.members] += row.innovation
        return pressures

    @property
    def load_covariance(self) -> Floats:
        """Covariance of the load amplitudes, shape (loads, loads)."""
        chambers = self.unknowns.chambers
        ratios = np.multiply.outer(self.force_ratios, self.force_ratios)
        covariance: Floats = ratios * self.covariance[chambers:, chambers:]
        # On the diagonal alone: a relative error points in any direction.
        grown = np.dot(self.relative_variances, self.inputs.loads**2)
        covariance.reshape(-1)[:: len(covariance) + 1] += grown
        return covariance

    @cached_property
    def frame_covariance(self) -> Floats:
        """Covariance of the stacked section twists ([m], [rad]), shape (6 sections, 6 sections)."""
        covariance: Floats = self.motion @ self.covariance @ self.motion.T
        return covariance

    @property
    def frame_deviations(self) -> Floats:
        """Standard deviations of the stacked section twists ([m], [rad]), shape (6 sections,)."""
        deviations = np.empty(len(self.motion))
        _deviate(self.motion, self.covariance, deviations)
        return deviations

    @cached_property
    def normalised_innovation_squared(self) -> float:
        """Weighted sum of squares that the data keep at the estimate; chi-square where the model is right."""
        return sum(row.cost for row in self.rows if row.data)

    @cached_property
    def degrees_of_freedom(self) -> float:
        """Expectation of ``normalised_innovation_squared``: data less what they were spent on.

        With S the covariance of the estimate and D = J^T R^-1 J the data's information, n - tr(S D): a prior
        that determines half of an unknown leaves half of a degree of freedom to the data.
        """
        data = [row for row in self.rows if row.data]
        spent = sum(float(np.vdot(self.covariance, row.normal)) for row in data)
        return sum(len(row.innovation) for row in data) - spent

    @cached_property
    def observability(self) -> Observability:
        """What the data determine."""
        data = [row for row in self.rows if row.data and len(row.innovation)]
        size = self.unknowns.size
        jacobian = np.concatenate([row.jacobian for row in data]) if data else np.zeros((0, size))
        information = np.zeros((len(jacobian), len(jacobian)))
        start = 0
        for row in data:
            end = start + len(row.innovation)
            information[start:end, start:end] = row.information
            start = end
        return analyse(self.unknowns, ~self.limits.held, jacobian, information)

    @property
    def unobservable_directions(self) -> tuple[str, ...]:
        """Combinations of inputs that the data do not see, in words."""
        return self.observability.unobservable_directions

    @property
    def limits_reached(self) -> tuple[str, ...]:
        """Names of the inputs that lie on a bound, with the bound."""
        low, high = self.limits.reached(self.vector, self.unknowns.scale)
        return tuple(
            f"{name} at its {side} limit of {bound:g} {unit}"
            for flags, side, bounds in ((low, "lower", self.limits.lower), (high, "upper", self.limits.upper))
            for name, unit, bound, flag in zip(
                self.unknowns.names, self.unknowns.units, bounds, flags, strict=True
            )
            if flag
        )


def posterior(rows: tuple[WeightedRows, ...], scale: Floats, fixed: Flags) -> Floats:
    """Return the covariance of the inputs, (sum J^T R^-1 J)^-1 over those that can move.

    A direction that nothing determines has a standard deviation of 1e3 times its scale instead of
    infinity.

    Args:
        rows: Linearised objectives.
        scale: Typical change of each input, shape (inputs,).
        fixed: Inputs that are held or lie on a bound, shape (inputs,).
    """
    covariance = np.zeros((len(scale), len(scale)))
    _posterior(sum_of(row.normal for row in rows), scale, fixed, covariance)
    return covariance


@njit(cache=True, nogil=True)
def _posterior(information: Floats, scale: Floats, fixed: Flags, covariance: Floats) -> None:
    """Fill the covariance of the inputs that can move, zeros for the others."""
    free = np.flatnonzero(~fixed)
    count = len(free)
    scaled, inverse = np.empty((count, count)), np.empty((count, count))
    for r in range(count):
        for c in range(count):
            scaled[r, c] = information[free[r], free[c]] * scale[free[r]] * scale[free[c]]
        scaled[r, r] += 1e-6
    invert(scaled, inverse)
    for r in range(count):
        for c in range(count):
            covariance[free[r], free[c]] = inverse[r, c] * scale[free[r]] * scale[free[c]]


@njit(cache=True, nogil=True)
def _deviate(motion: Floats, covariance: Floats, deviations: Floats) -> None:
    """Fill the roots of the diagonal of motion covariance motion^T."""
    for row in range(len(motion)):
        variance = 0.0
        for r in range(len(covariance)):
            for c in range(len(covariance)):
                variance += motion[row, r] * covariance[r, c] * motion[row, c]
        deviations[row] = np.sqrt(max(variance, 0.0))


@dataclass(frozen=True)
class Problem:
    """Objectives and limits of one instant.

    Args:
        unknowns: Names and scales of the inputs.
        suite: The sensors, whose rows are named ``sensors`` in the objectives.
        objectives: What the inputs should meet.
        limits: Bounds and held inputs.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
        force_ratios: See ``ArmEstimate``.
        relative_variances: Likewise.
    """

    unknowns: Unknowns
    suite: SensorSuite
    objectives: tuple[Objective, ...]
    limits: InputBounds
    gravity: Floats
    force_ratios: Floats | float = 1.0
    relative_variances: Floats | float = 0.0

    def solve(
        self,
        model: ArmModel[State, Step],
        start: tuple[State, Inputs],
        tolerances: Tolerances | None = None,
        warm_start: Linearised[State] | None = None,
    ) -> ArmEstimate[State]:
        """Search for the inputs.

        Args:
            model: The arm, with the loads that are unknown.
            start: State and inputs from which to search.
            tolerances: When the search ends.
            warm_start: Linearisation of an earlier search, from which this one goes on if it serves.
        """
        state, inputs = start
        start = (state, Inputs(inputs.pressures, inputs.loads, self.gravity))
        minimum = minimise(model, self.unknowns, self.objectives, self.limits, start, tolerances, warm_start)
        low, high = self.limits.reached(minimum.vector, self.unknowns.scale)
        residual = np.full(self.suite.size, np.nan)
        for row in minimum.rows:
            if row.name == "sensors":
                residual[row.members] = row.innovation
        return ArmEstimate(
            **vars(minimum),
            unknowns=self.unknowns,
            inputs=self.unknowns.inputs(minimum.vector, self.gravity),
            covariance=posterior(minimum.rows, self.unknowns.scale, self.limits.held | low | high),
            limits=self.limits,
            residuals={name: residual[rows] for name, rows in self.suite.slices.items()},
            force_ratios=self.force_ratios,
            relative_variances=self.relative_variances,
        )

    def prepared(self, model: ArmModel[State, Step], estimate: ArmEstimate[State]) -> Linearised[State]:
        """Linearise a model at an estimate, so that the next search has less to do; see ``linearise_at``."""
        return linearise_at(model, self.unknowns, self.objectives, self.limits, estimate, self.gravity)

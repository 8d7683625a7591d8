"""Teach mode: pressures for a wanted pose, and whether the arm can take it."""

from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.inverse.estimate import Estimate
from softarm.estimator.inverse.minimise import Tolerances
from softarm.estimator.inverse.observability import join
from softarm.estimator.inverse.problem import Problem, pose_problem
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation
from softarm.estimator.sensing import SensorSuite

Floats = NDArray[np.float64]
State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


STEP = 5e-3
"""Change of a pressure, in units of its scale, at which a search ends.

Where pressures are free it creeps to the preferred ones long after the pose is reached.
"""
CAUTIOUS_RADIUS = 0.3
"""Trust region of the search that is tried when one with long steps fails, in units of the inputs' scale."""
CAUTIOUS_STEPS, CAUTIOUS_RETREATS = 40, 4


@dataclass(frozen=True)
class Reach(Generic[State]):
    """The pose nearest to a wanted one.

    Args:
        estimate: Pressures, frames and residuals of the nearest pose.
        reachable: Whether every residual is within its tolerance.
        statement: The answer in words, with what limits the arm.
    """

    estimate: Estimate[State]
    reachable: bool
    statement: str

    @property
    def pressures(self) -> Floats:
        """Gauge pressures in the chambers [Pa], shape (chambers,)."""
        return self.estimate.inputs.pressures


def reach_pose(
    model: ArmModel[State, Step],
    suite: SensorSuite,
    target: Floats,
    pressure_limits: Floats,
    start: tuple[State, Inputs],
    tolerances: Tolerances | None = None,
    preferred: Floats | None = None,
    guide: ArmModel[Any, Any] | None = None,
) -> Reach[State]:
    """Find the pressures within [0, limit] that bring the unloaded arm nearest to a pose.

    Args:
        model: Model of the arm.
        suite: Sensors that describe the pose; their standard deviations are its tolerances.
        target: Readings that they would give in the pose, NaN where it does not matter, shape (readings,).
        pressure_limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        start: A state and inputs to begin with.
        tolerances: When to stop; by default once pressures change by less than 100 Pa.
        preferred: Pressures to prefer where the pose leaves a choice [Pa], shape (chambers,); those of
            ``start`` when left out.
        guide: A fast model with the same chambers and loads, at whose answer the search begins.
    """
    state, inputs = start
    unknowns = Unknowns.of(model.chambers, model.loads)
    unloaded = Inputs(
        np.minimum(np.maximum(inputs.pressures, 0.0), pressure_limits),
        np.zeros(len(model.loads)),
        inputs.gravity,
    )
    wish = unloaded.pressures if preferred is None else preferred
    problem = pose_problem(unknowns, suite, target, pressure_limits, wish, inputs.gravity)
    tolerances = tolerances or Tolerances(step=STEP)
    begin = None if guide is None else _guided(model, guide, problem, unloaded, tolerances)
    if begin is None:
        begin = (_unloaded(model, state, unloaded), unloaded)
    estimate = problem.solve(model, begin, tolerances)
    if not estimate.converged:
        estimate = problem.solve(model, begin, cautious(tolerances))
    misses = _misses(suite, target, estimate)
    reachable = estimate.converged and not misses
    return Reach(estimate, reachable, _statement(estimate, reachable, misses))


def cautious(tolerances: Tolerances) -> Tolerances:
    """Go by short steps: a pose far away leads a search with long ones to where the arm has none."""
    return replace(tolerances, radius=CAUTIOUS_RADIUS, iterations=CAUTIOUS_STEPS, retreats=CAUTIOUS_RETREATS)


def _guided(
    model: ArmModel[State, Step],
    guide: ArmModel[Any, Any],
    problem: Problem,
    unloaded: Inputs,
    tolerances: Tolerances,
) -> tuple[State, Inputs] | None:
    """Give the model's state under the pressures that a guide finds, None where one of the two finds none."""
    begun, found = guide.solve(unloaded, guide.rest())
    if not found:
        return None
    answer = problem.solve(guide, (begun, unloaded), cautious(tolerances))
    if answer.status == "diverged":
        return None
    state, found = model.solve(answer.inputs, model.rest())
    return (state, answer.inputs) if found else None


def _unloaded(model: ArmModel[State, Step], state: State, inputs: Inputs) -> State:
    """Bring a state to equilibrium without loads: a search that begins far from one diverges."""
    for start in (state, model.rest()):
        found, converged = model.solve(inputs, start)
        if converged:
            return found
    return state


def _misses(suite: SensorSuite, target: Floats, estimate: Estimate[State]) -> list[str]:
    """Tell by how much each sensor's target is missed, where by more than its tolerance."""
    missed, start = [], 0
    for measurement in suite.measurements:
        reading = target[start : start + measurement.reading_size]
        start += measurement.reading_size
        tolerance = np.sqrt(np.diag(measurement.covariance(reading)))
        residual = estimate.residuals[measurement.name]
        if (np.abs(np.nan_to_num(residual)) > tolerance).any():
            sizes = ", ".join(f"{value:.2g}" for value in residual)
            allowed = ", ".join(f"{value:.2g}" for value in tolerance)
            missed.append(f"{measurement.name} misses by ({sizes}) of ({allowed}) allowed")
    return missed


def _statement(estimate: Estimate[State], reachable: bool, misses: list[str]) -> str:
    if reachable:
        return "The pose can be reached."
    if not estimate.converged:
        return f"The search did not converge ({estimate.status.replace('_', ' ')}); nothing is known."
    limits = estimate.limits_reached
    why = join(limits) if limits else "no pressure is at a limit, and no combination of them comes nearer"
    return f"The pose cannot be reached: {join(misses)}; {why}."

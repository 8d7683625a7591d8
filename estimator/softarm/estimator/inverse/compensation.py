"""Pressures in place of loads, or towards a pose: a bounded least-squares step, and the search beyond it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.estimate import ArmEstimate, Problem
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.minimise import Tolerances
from softarm.estimator.inverse.objectives import PressureReadings, SensorObjective
from softarm.estimator.inverse.observability import join
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation
from softarm.estimator.sensing import SensorSuite

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

TOLERANCE = 3.0
"""A pose is met when every reading is within so many standard deviations of what it would be there."""
PRESSURE_REGULARISATION = 30.0
"""A change by a chamber's whole range weighs as much as so many standard deviations of a reading.

A bend amounts to hundreds of them, so it is hardly held back; a twist, which no pressure causes, does not
lead to pressures that do little else.
"""
CAUTIOUS_RADIUS = 0.3
"""Trust region of the search that is tried when one with long steps fails, in units of the inputs' scale."""
CAUTIOUS_STEPS, CAUTIOUS_REJECTIONS = 40, 4


@dataclass(frozen=True)
class Compensation:
    """A change of the pressures, and what it cannot do.

    Args:
        change: Change of the gauge pressures in the chambers [Pa], shape (chambers,).
        reachable: Whether every sensor would read within its tolerance of what it should.
        statement: The answer in words, with what limits the arm.
    """

    change: Floats
    reachable: bool
    statement: str


def replace_loads(
    estimate: ArmEstimate[State], suite: SensorSuite, limits: Floats, tare: Floats
) -> Compensation:
    """Find the pressures that hold the estimated pose once its loads are gone.

    With J_L and J_p the readings' derivatives by loads and pressures at the estimate, and R their covariance:
    minimise |J_L (L - L_tare) - J_p dp|^2 over R within the limits. The configuration is the same with the
    loads as with the pressures, so one linearisation about it serves also far from rest.

    Args:
        estimate: The estimate; its pose is to be held.
        suite: Sensors whose standard deviations are the tolerances.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        tare: Load amplitudes that count as zero, shape (loads,).
    """
    readings = suite.predict(estimate.frames)
    jacobian = suite.sensitivity(estimate.frames, readings).twists @ estimate.motion
    wanted = jacobian[:, estimate.unknowns.chambers :] @ (estimate.inputs.loads - tare)
    return _solve(estimate, suite, limits, (readings, jacobian, wanted), estimate.inputs.pressures)


def settle(
    model: ArmModel[State, Step],
    estimate: ArmEstimate[State],
    suite: SensorSuite,
    limits: Floats,
    tare: Floats,
    first: Compensation,
    tolerances: Tolerances | None = None,
) -> tuple[Compensation, ArmEstimate[State] | None]:
    """Search on from the result of ``replace_loads`` to the optimum of the nonlinear arm, its loads gone.

    Args:
        model: Model of the arm.
        estimate: The estimate; its pose is to be held.
        suite: Sensors whose standard deviations are the tolerances.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        tare: Load amplitudes that count as zero, shape (loads,).
        first: The result of ``replace_loads``.
        tolerances: When the search stops.

    Returns:
        The better answer with the arm in it, or the first one and None where the search did not converge.
    """
    unknowns, inputs, chambers = estimate.unknowns, estimate.inputs, estimate.unknowns.chambers
    readings = suite.predict(estimate.frames)
    bounds = InputBounds.free(unknowns.size).bound(slice(0, chambers), 0.0, limits)
    problem = Problem(
        unknowns,
        suite,
        (
            SensorObjective(suite, readings),
            PressureReadings(inputs.pressures, limits / PRESSURE_REGULARISATION, "reluctance", data=False),
        ),
        bounds.hold(slice(chambers, unknowns.size), tare),
        inputs.gravity,
    )
    # Out of equilibrium the cost is a forecast, and from as far as this one that leads astray.
    clipped = Inputs(np.clip(inputs.pressures + first.change, 0.0, limits), tare, inputs.gravity)
    state, settled = model.solve(clipped, estimate.state)
    if not settled:
        return first, None
    start = state, clipped
    tolerances = tolerances or Tolerances()
    solution = problem.solve(model, start, tolerances)
    if not solution.converged:
        solution = problem.solve(model, start, cautious(tolerances))
    if not solution.converged:
        return first, None
    residual = np.concatenate([solution.residuals[name] for name in suite.slices])
    sigma = np.sqrt(np.diag(suite.sensor_noise(readings)))
    misses = _misses(suite, residual, sigma)
    change = solution.inputs.pressures - inputs.pressures
    statement = _statement(misses, list(solution.limits_reached))
    return Compensation(change, not misses, statement), solution


def approach(
    estimate: ArmEstimate[State],
    suite: SensorSuite,
    limits: Floats,
    target: Frames,
    applied: Floats,
    left_there: Mapping[str, Floats] = MappingProxyType({}),
) -> Compensation:
    """Find the change of the pressures that brings the arm from the estimated pose to another.

    Args:
        estimate: The estimate.
        suite: Sensors that describe the pose.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        target: Frames of the sections in the wanted pose, as they were estimated there.
        applied: What can be taken away from each chamber: its pressure as it is measured [Pa], shape
            (chambers,). An estimate may see pressure in a vented one.
        left_there: Residuals of the estimate there by sensor. With them the readings themselves are led back
            to what they were, whatever share of them the estimate does not explain here or there.
    """
    readings = suite.predict(target)
    sensitivity = suite.sensitivity(estimate.frames, readings)
    wanted = sensitivity.innovation.copy()
    for name, rows in suite.slices.items():
        if name in left_there:
            wanted[rows] += np.nan_to_num(left_there[name] - estimate.residuals[name])
    return _solve(estimate, suite, limits, (readings, sensitivity.twists @ estimate.motion, wanted), applied)


def _solve(
    estimate: ArmEstimate[State],
    suite: SensorSuite,
    limits: Floats,
    problem: tuple[Floats, Floats, Floats],
    applied: Floats,
) -> Compensation:
    """Solve for readings, their derivative by the inputs, and the change of them that is wanted."""
    readings, jacobian, wanted = problem
    chambers = estimate.unknowns.chambers
    twists = suite.sensitivity(estimate.frames, readings).twists
    covariance = suite.covariance(estimate.frames, readings, twists)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    by_pressures = jacobian[:, :chambers] * limits
    matrix = np.concatenate([whiten @ by_pressures, PRESSURE_REGULARISATION * np.eye(chambers)])
    right = np.concatenate([whiten @ wanted, np.zeros(chambers)])
    # BVLS wants room between the bounds, also where a chamber has none.
    low = np.minimum(-applied, 0.0) / limits - 1e-9
    high = np.maximum(limits - applied, 0.0) / limits + 1e-9
    share = lsq_linear(matrix, right, (low, high), method="bvls").x
    residual = wanted - by_pressures @ share
    misses = _misses(suite, residual, np.sqrt(np.diag(covariance)))
    bounds = [
        f"chamber {chamber} at {'zero' if value < 0.5 * (low + high)[chamber] else 'its limit'}"
        for chamber, value in enumerate(share)
        if value <= low[chamber] + 1e-6 or value >= high[chamber] - 1e-6
    ]
    return Compensation(share * limits, not misses, _statement(misses, bounds))


def _misses(suite: SensorSuite, residual: Floats, sigma: Floats) -> list[str]:
    """Return by how much each sensor's reading would be missed, where by more than its tolerance."""
    misses = []
    for name, rows in suite.slices.items():
        ratio = float(np.max(np.abs(residual[rows]) / sigma[rows], initial=0.0))
        if ratio > TOLERANCE:
            size = _size(residual[rows], np.array(suite.units[rows]))
            misses.append(f"{name} misses by {size} ({ratio:.0f} standard deviations)")
    return misses


def _size(residual: Floats, units: NDArray[np.str_]) -> str:
    """Write the size of a residual: of its lengths in millimetres, of its rotations in degrees."""
    sizes = {"mm": 1e3 * residual[units == "m"], "degrees": np.degrees(residual[units == "rad"])}
    return join([f"{np.linalg.norm(part):.2g} {name}" for name, part in sizes.items() if len(part)])


def _statement(misses: list[str], bounds: list[str]) -> str:
    if not misses:
        return "The pose can be reached."
    why = join(bounds) if bounds else "no combination of the pressures comes nearer"
    return f"The pose cannot be reached: {join(misses)}; {why}."


def cautious(tolerances: Tolerances) -> Tolerances:
    """Shorten the steps: a search for a pose far away with long ones ends where the arm has none."""
    return replace(
        tolerances, radius=CAUTIOUS_RADIUS, iterations=CAUTIOUS_STEPS, rejections=CAUTIOUS_REJECTIONS
    )

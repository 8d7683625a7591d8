"""Where along the arm a force acts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from softarm.estimator.errors import InputError
from softarm.estimator.inverse.estimate import Estimate
from softarm.estimator.inverse.minimise import Tolerances
from softarm.estimator.inverse.problem import forces_problem, independent_prior
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation, Load
from softarm.estimator.sensing import SensorSuite

Floats = NDArray[np.float64]
State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

CHI_SQUARE_95 = 3.841
"""95th percentile of chi-square with one degree of freedom."""


@dataclass(frozen=True)
class ContactLocation(Generic[State]):
    """A force and its place.

    Args:
        height: Most likely rest distance from the base [m].
        interval: Heights that the data do not reject at 95 % (likelihood ratio), lowest and highest [m].
        estimate: Estimate with the force at that height.
        heights: Candidate heights [m], shape (candidates,).
        cost: Weighted sum of squares at each candidate, shape (candidates,).
        located: Whether the interval is shorter than half of the candidates' range.
        statement: The answer in words.
    """

    height: float
    interval: tuple[float, float]
    estimate: Estimate[State]
    heights: Floats
    cost: Floats
    located: bool
    statement: str

    @property
    def force(self) -> Floats:
        """Force in the base frame [N], shape (3,) or (2,) without an axial part."""
        return self.estimate.inputs.loads


@dataclass(frozen=True)
class ContactSearch(Generic[State, Step]):
    """What a search for a contact runs on.

    Args:
        with_loads: Gives the model with other loads.
        suite: The sensors.
        pressure_sigma: Standard deviation of each chamber pressure [Pa], shape (chambers,), or ``None`` for
            exact pressures.
        force_sigma: Standard deviation assumed for each component of the force [N].
        axial: Whether the force may have a component along z.
        tolerances: When each search for the force stops.
    """

    with_loads: Callable[[tuple[Load, ...]], ArmModel[State, Step]]
    suite: SensorSuite
    pressure_sigma: Floats | None
    force_sigma: float = 2.0
    axial: bool = False
    tolerances: Tolerances | None = None

    def loads(self, height: float) -> tuple[Load, ...]:
        """Give the components of a force at a height."""
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))[: 3 if self.axial else 2]
        return tuple(
            Load(f"contact_{name}", "force", axis, height=height)
            for name, axis in zip("xyz", axes, strict=False)
        )


def locate_force(
    search: ContactSearch[State, Step],
    heights: Floats,
    readings: Floats,
    pressures: Floats,
    gravity: Floats,
) -> ContactLocation[State]:
    """Find the height at which one force explains the readings best.

    Every candidate height gets its own best force; the profile of the weighted sum of squares over the
    heights is the likelihood, c(h) - min c of 3.84 bounds the 95 % interval (Wilks 1938).

    Args:
        search: Model and sensors.
        heights: Candidate rest distances from the base [m], rising, shape (candidates,).
        readings: Stacked readings of one instant, shape (readings,).
        pressures: Gauge pressures in the chambers [Pa], shape (chambers,).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).

    Raises:
        InputError: If the present sensors offer no more numbers than the force has components.
    """
    present = int(np.isfinite(readings).sum())
    components = 3 if search.axial else 2
    if present <= components:
        what = f"{present} readings for {components} force components and a height"
        raise InputError("contact", what, "give more sensors, or fix the height")
    starts: dict[float, Estimate[State]] = {}

    def solve(height: float) -> Estimate[State]:
        near = min(starts, key=lambda known: abs(known - height), default=None)
        estimate = _best_force(
            search, height, readings, pressures, gravity, starts.get(near) if near else None
        )
        starts[height] = estimate
        return estimate

    cost = np.array([_cost(solve(float(height))) for height in heights])
    best = int(np.argmin(cost))
    low, high = heights[max(best - 1, 0)], heights[min(best + 1, len(heights) - 1)]
    refined = minimize_scalar(
        lambda height: _cost(solve(float(height))),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-5},
    )
    height, least = (refined.x, refined.fun) if refined.fun < cost[best] else (heights[best], cost[best])
    interval = _interval(heights, cost, float(height), float(least))
    located = interval[1] - interval[0] < 0.5 * (heights[-1] - heights[0])
    return ContactLocation(
        float(height),
        interval,
        starts[float(height)],
        heights,
        cost,
        located,
        _statement(float(height), interval, located),
    )


def _best_force(
    search: ContactSearch[State, Step],
    height: float,
    readings: Floats,
    pressures: Floats,
    gravity: Floats,
    near: Estimate[State] | None,
) -> Estimate[State]:
    model = search.with_loads(search.loads(height))
    unknowns = Unknowns.of(model.chambers, model.loads)
    prior = independent_prior(unknowns, search.force_sigma)
    problem = forces_problem(
        unknowns, search.suite, readings, pressures, search.pressure_sigma, prior, gravity
    )
    if near is not None:
        return problem.solve(model, (near.state, near.inputs), search.tolerances)
    inputs = Inputs(pressures, np.zeros(len(model.loads)), gravity)
    state, _ = model.solve(inputs, model.rest())
    return problem.solve(model, (state, inputs), search.tolerances)


def _cost(estimate: Estimate[State]) -> float:
    return sum(row.cost for row in estimate.rows) if estimate.converged else float("inf")


def _interval(heights: Floats, cost: Floats, height: float, least: float) -> tuple[float, float]:
    """Interpolate the profile at its 95 % level, outwards from the best height."""
    at = np.concatenate([heights, [height]])
    order = np.argsort(at)
    at, profile = at[order], np.concatenate([cost, [least]])[order] - least
    inside = np.flatnonzero(profile <= CHI_SQUARE_95)
    ends = []
    for edge, outside in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
        if not 0 <= outside < len(at) or not np.isfinite(profile[outside]):
            ends.append(float(at[edge]))
            continue
        share = (CHI_SQUARE_95 - profile[edge]) / (profile[outside] - profile[edge])
        ends.append(float(at[edge] + share * (at[outside] - at[edge])))
    return ends[0], ends[1]


def _statement(height: float, interval: tuple[float, float], located: bool) -> str:
    low, high = (1e3 * end for end in interval)
    if located:
        return f"The force acts {1e3 * height:.0f} mm from the base ({low:.0f} to {high:.0f} mm at 95 %)."
    return f"The force cannot be placed: anywhere from {low:.0f} to {high:.0f} mm explains the readings."

"""Nonlinear fit of effects, with all that is common to the recordings marginalised."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.marginal import Marginaliser
from softarm.estimator.diagnosis.normal_equations import NewColumns, Total
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.effects import ParameterSpec
from softarm.estimator.effects.placed import PlacedEffect

ITERATIONS = 10
STEP = 1e-3
EXACT_STEP = 0.03
"""Step of the differences, in units of the fit, to first order and on the model itself, which iterates."""
SETTLED = 0.02
"""Improvement of the cost that ends a fit."""
LARGEST = 1.5
"""Longest step of a parameter in units of the fit."""
FIRST_DAMPING, LEAST_DAMPING = 1e-2, 1e-6
MOST_REFUSED = 4
"""Steps in a row that may make the fit worse."""


@dataclass(frozen=True)
class RecordingResidual:
    """The residual of one session, weighted for a fit.

    Args:
        stage: The session on the calibrated model.
        residual: Over its scale, lost ones zero, shape (samples, rows).
        weight: Inverse scale, zero for lost or held-out residuals, shape (samples, rows).
        common: Columns of the common coefficients over their scale, for ``seen``, shape (seen, columns).
        beside: Effects whose change the residual is without.
    """

    stage: Stage
    residual: Floats
    weight: Floats
    common: NDArray[np.float32]
    beside: tuple[PlacedEffect, ...] = ()

    @cached_property
    def seen(self) -> Indices:
        """Residuals that have a weight, shape (seen,)."""
        return np.flatnonzero(self.weight)


@dataclass(frozen=True)
class MarginalisedProblem:
    """What fits see, with the common coefficients marginalised.

    Args:
        residuals: Of each session.
        stretches: All of their stretches that fits see.
    """

    residuals: tuple[RecordingResidual, ...]
    stretches: Marginaliser

    @classmethod
    def alone(cls, residuals: Sequence[RecordingResidual], fraction: float = 1.0) -> "MarginalisedProblem":
        """Prepare fits beside nothing common; residuals then have one common column, of zeros."""
        none = Total(0, np.zeros((1, 1)), np.zeros(1), 0.0)
        return cls(tuple(residuals), Marginaliser.of(none, Gaussian(np.zeros(1), np.eye(1)), fraction))

    def projected(self, changes: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Return M and b for whitened changes of all sessions, each of shape (samples * rows, k)."""
        k = changes[0].shape[1]
        gram, vector = np.zeros((k, k)), np.zeros(k)
        cross = np.zeros((len(self.stretches.right), k))
        for recorded, change in zip(self.residuals, changes, strict=True):
            seen = change[recorded.seen]
            # A trial beyond all stable equilibria may overflow; its gain is not finite, so it is refused.
            with np.errstate(over="ignore", invalid="ignore"):
                gram += seen.T @ seen
                vector += seen.T @ recorded.residual.ravel()[recorded.seen]
                cross += _cross(recorded.common, np.ascontiguousarray(seen.T, dtype=np.float32)).T
        marginal = self.stretches.marginal(NewColumns(cross, gram, vector))
        return marginal.matrix, marginal.vector


@njit(cache=True, nogil=True)
def _cross(common: NDArray[np.float32], changes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Multiply changes, shape (k, seen), by the common columns, shape (seen, columns).

    The columns fill tens of megabytes, so that reading them takes the time. BLAS reads them once for each of
    a few changes; here they are read once for all.
    """
    count, (rows, columns) = len(changes), common.shape
    products = np.zeros((count, columns), dtype=np.float32)
    whole = rows - rows % 4
    for r in range(0, whole, 4):  # four rows at once: products are read and written a quarter as often
        for k in range(count):
            c0, c1, c2, c3 = changes[k, r], changes[k, r + 1], changes[k, r + 2], changes[k, r + 3]
            for n in range(columns):
                near = c0 * common[r, n] + c1 * common[r + 1, n]
                products[k, n] += near + c2 * common[r + 2, n] + c3 * common[r + 3, n]
    for r in range(whole, rows):
        for k in range(count):
            for n in range(columns):
                products[k, n] += changes[k, r] * common[r, n]
    return products


@dataclass(frozen=True)
class Fit:
    """Where a fit of effects ended.

    Args:
        hypotheses: The effects and their places.
        thetas: Their parameters.
        covariance: Of all parameters, in the units of the fit, shape (parameters, parameters).
        gain: By how much they lower the cost against none of them.
        exact: Whether it rests on the model itself and not on its linearisation.
    """

    hypotheses: tuple[Hypothesis, ...]
    thetas: tuple[Floats, ...]
    covariance: Floats
    gain: float
    exact: bool = False

    def joined(self, other: "Fit") -> "Fit":
        """Put another's effects behind these, to begin a joint fit."""
        return replace(
            self, hypotheses=(*self.hypotheses, *other.hypotheses), thetas=(*self.thetas, *other.thetas)
        )

    def selected(self, kept: Sequence[int]) -> "Fit":
        """Return some effects as they are, in this order, to begin a fit of them."""
        return replace(
            self,
            hypotheses=tuple(self.hypotheses[k] for k in kept),
            thetas=tuple(self.thetas[k] for k in kept),
        )

    def inserted(self, other: "Fit", number: int) -> "Fit":
        """Put another fit's only effect among these, at a number, to begin a joint fit."""
        order = list(range(len(self.hypotheses)))
        order.insert(number, len(order))
        return self.joined(other).selected(order)

    def with_amplitudes(self, factor: float) -> "Fit":
        """Multiply all amplitudes, within their bounds."""
        scaled = []
        for hypothesis, theta in zip(self.hypotheses, self.thetas, strict=True):
            parameters = hypothesis.effect.parameters
            sizes = [factor if one.role == "amplitude" else 1.0 for one in parameters]
            bounds = [one.lower for one in parameters], [one.upper for one in parameters]
            scaled.append(np.clip(theta * sizes, *bounds))
        return replace(self, thetas=tuple(scaled))

    @property
    def at_bound(self) -> bool:
        """Whether an amplitude of any effect is at a bound that is not its neutral value."""
        return any(self.is_bounded(number) for number in range(len(self.thetas)))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of the parameters of all effects that were fitted."""
        return sum(hypothesis.effect.degrees_of_freedom for hypothesis in self.hypotheses)

    def is_bounded(self, number: int) -> bool:
        """Return whether an amplitude of one effect is at a bound that is not its neutral value."""
        own = Parametrisation.of((self.hypotheses[number],))
        return own.at_bound(own.units(self.thetas[number]))

    def stds(self, number: int) -> Floats:
        """Return the standard deviations of one effect's parameters, shape (parameters,)."""
        parameters, theta = self.hypotheses[number].effect.parameters, self.thetas[number]
        entries = zip(parameters, theta.tolist(), self.scaled_stds(number).tolist(), strict=True)
        return np.array([p.deviation(value, std) for p, value, std in entries])

    def scaled_stds(self, number: int) -> Floats:
        """Return the same in units of the fit."""
        stds: Floats = np.sqrt(np.maximum(np.diag(self.scaled_covariance(number)), 0.0))
        return stds

    def scaled_covariance(self, number: int) -> Floats:
        """Return the covariance of one effect's parameters in units of the fit."""
        ends = np.cumsum([0, *(len(theta) for theta in self.thetas)])
        own = slice(int(ends[number]), int(ends[number + 1]))
        return np.asarray(self.covariance[own, own], dtype=np.float64)


def fit_effects(
    problem: MarginalisedProblem,
    hypotheses: Sequence[Hypothesis],
    starts: Sequence[Floats],
    *,
    exact: bool = False,
    iterations: int = ITERATIONS,
    moving: Flags | None = None,
) -> Fit:
    """Fit the parameters of effects that act together (Levenberg-Marquardt, in bounds).

    Args:
        problem: What is fitted to, with the common coefficients.
        hypotheses: The effects.
        starts: Parameters to begin with.
        exact: Solve the model itself. Derivatives begin as those of its linearisation and follow what each
            step shows (Broyden 1965), for a strong effect changes them. Those by the parameters of a contact
            are taken anew at each step: how hard it is shows in a twentieth of what it changes.
        iterations: Largest number of steps tried.
        moving: Which parameters are fitted, shape (parameters,); all when left out, but no choices.
    """
    parametrisation = Parametrisation.of(hypotheses)
    values = parametrisation.units(np.concatenate(starts))
    moving = ~parametrisation.choices if moving is None else moving & ~parametrisation.choices

    def changed(at: Floats) -> list[Floats]:
        return whitened(problem, hypotheses, parametrisation.split(at), exact=exact)

    change = changed(values)
    gain, damping, refused = _gain(problem, change), FIRST_DAMPING, 0
    contacts = np.repeat(
        [exact and h.effect.responds_to_own_effect for h in hypotheses], parametrisation.sizes
    )
    follows = exact and not contacts.all()

    def anew() -> None:
        """Differentiate by the parameters of contacts, if there are any, on the model itself."""
        if not contacts.any():
            return
        ahead = slopes_of(problem, hypotheses, parametrisation, values, change, exact=True, chosen=contacts)
        for slope, there in zip(slopes, ahead, strict=True):
            slope[:, contacts] = there[:, contacts]

    here = parametrisation.split(values)
    linear = whitened(problem, hypotheses, here, exact=False) if follows else change
    slopes = slopes_of(problem, hypotheses, parametrisation, values, linear, chosen=~contacts)
    if follows:  # without amplitudes nothing changes
        _secant(slopes, np.where(parametrisation.amplitudes, values - parametrisation.centres, 0.0), change)
    anew()
    normal: tuple[Floats, Floats] | None = None
    for _ in range(iterations):
        matrix, pull = normal = normal or _normal(problem, slopes, change, parametrisation, values)
        damped = (matrix + damping * np.diag(np.diag(matrix)))[np.ix_(moving, moving)]
        step = np.zeros_like(values)
        step[moving] = np.clip(np.linalg.solve(damped, pull[moving]), -LARGEST, LARGEST)
        trial = np.clip(values + step, parametrisation.lower, parametrisation.upper)
        tried = changed(trial)
        reached = _gain(problem, tried)
        improved = reached - parametrisation.penalty(trial) - gain + parametrisation.penalty(values)
        if follows:
            _secant(slopes, trial - values, [t - c for t, c in zip(tried, change, strict=True)])
            normal = None
        if not improved > 0.0:
            damping, refused = 10.0 * damping, refused + 1
            if refused == MOST_REFUSED:
                break
            continue
        values, change, gain, refused, normal = trial, tried, reached, 0, None
        damping = max(0.1 * damping, LEAST_DAMPING)
        if not exact:
            slopes = slopes_of(problem, hypotheses, parametrisation, values, change)
        anew()
        if improved < SETTLED:
            break
    matrix, _ = normal or _normal(problem, slopes, change, parametrisation, values)
    thetas = tuple(parametrisation.split(values))
    return Fit(
        tuple(hypotheses),
        thetas,
        np.asarray(np.linalg.inv(matrix), dtype=np.float64),
        gain,
        exact,
    )


def fit_laws(problem: MarginalisedProblem, hypotheses: Sequence[Hypothesis], starts: Sequence[Floats]) -> Fit:
    """Fit effects to first order under each of the laws that their choices offer, and keep the best.

    Args:
        problem: What is fitted to, with the common coefficients.
        hypotheses: The effects.
        starts: Parameters to begin with.
    """
    best = fit_effects(problem, hypotheses, starts)
    for number, hypothesis in enumerate(hypotheses):
        for index, parameter in enumerate(hypothesis.effect.parameters):
            for choice in parameter.choices:
                if choice != best.thetas[number][index]:
                    others = [theta.copy() for theta in best.thetas]
                    others[number][index] = choice
                    again = fit_effects(problem, hypotheses, others)
                    best = max(best, again, key=lambda one: one.gain)
    return best


def _normal(
    problem: MarginalisedProblem,
    slopes: list[Floats],
    change: list[Floats],
    parametrisation: "Parametrisation",
    values: Floats,
) -> tuple[Floats, Floats]:
    """Return the normal equations of a step: the matrix and the right side."""
    both = [np.column_stack([s, c]) for s, c in zip(slopes, change, strict=True)]
    return parametrisation.step(*problem.projected(both), values)


def _secant(slopes: list[Floats], step: Floats, change: list[Floats]) -> None:
    """Let slopes give a change that was seen along a step (Broyden's rank-one update)."""
    length = float(step @ step)
    if length == 0.0 or not all(np.isfinite(c).all() for c in change):
        return
    for slope, observed in zip(slopes, change, strict=True):
        slope += (observed[:, 0] - slope @ step)[:, None] * (step / length)


def whitened(
    problem: MarginalisedProblem, hypotheses: Sequence[Hypothesis], thetas: Sequence[Floats], *, exact: bool
) -> list[Floats]:
    """Return what effects change, over the residuals' scale, each session flattened to one column."""
    changes = []
    for recorded in problem.residuals:
        placed = placed_effects(recorded.stage, hypotheses, thetas)
        change = recorded.stage.change(placed, exact=exact, beside=recorded.beside)
        changes.append(np.nan_to_num(change * recorded.weight, nan=0.0).reshape(-1, 1))
    return changes


def placed_effects(
    stage: Stage, hypotheses: Sequence[Hypothesis], thetas: Sequence[Floats]
) -> tuple[PlacedEffect, ...]:
    """Return those of some effects that act in a session: not on sensors that it does not have."""
    world = stage.world
    return tuple(
        hypothesis.placed(world, theta)
        for hypothesis, theta in zip(hypotheses, thetas, strict=True)
        if hypothesis.place.sensor in (None, *world.sensors)
    )


def placed_in(stage: Stage, fit: Fit | None) -> tuple[PlacedEffect, ...]:
    """Return the effects of a fit that act in a session."""
    return () if fit is None else placed_effects(stage, fit.hypotheses, fit.thetas)


def change_by(stage: Stage, fit: Fit | None, beside: Fit | None = None) -> Floats:
    """Return what the effects of a fit change in a session beside others, shape (samples, rows)."""
    exact = fit is not None and fit.exact
    return stage.change(placed_in(stage, fit), exact=exact, beside=placed_in(stage, beside))


def gain_of(
    problem: MarginalisedProblem,
    hypotheses: Sequence[Hypothesis],
    thetas: Sequence[Floats],
    *,
    exact: bool = True,
) -> float:
    """Return by how much effects lower the cost on the model itself, or to first order."""
    return _gain(problem, whitened(problem, hypotheses, thetas, exact=exact))


def _gain(problem: MarginalisedProblem, change: Sequence[Floats]) -> float:
    matrix, vector = problem.projected(change)
    return float(2.0 * vector[0] - matrix[0, 0])


def slopes_of(
    problem: MarginalisedProblem,
    hypotheses: Sequence[Hypothesis],
    parametrisation: "Parametrisation",
    values: Floats,
    change: Sequence[Floats],
    *,
    exact: bool = False,
    chosen: Flags | None = None,
) -> list[Floats]:
    """Differentiate what effects change by the parameters in units of the fit.

    Args:
        problem: What is fitted to.
        hypotheses: The effects.
        parametrisation: Of their parameters.
        values: Their parameters in units of the fit, shape (parameters,).
        change: What they change there; see ``whitened``.
        exact: Whether the model itself is solved.
        chosen: By which parameters, shape (parameters,); by all when left out.

    Returns:
        Of each session, shape (samples * rows, parameters); zero for choices between laws, and others.
    """

    def changed(thetas: Sequence[Floats]) -> list[Floats]:
        return whitened(problem, hypotheses, thetas, exact=exact)

    size = EXACT_STEP if exact else STEP
    slopes = differentiated(parametrisation, values, changed, change, size=size, chosen=chosen)
    return [slope[:, 0] for slope in slopes]


def differentiated(
    parametrisation: "Parametrisation",
    values: Floats,
    changed: Callable[[Sequence[Floats]], Sequence[Floats]],
    here: Sequence[Floats],
    *,
    size: float = STEP,
    chosen: Flags | None = None,
) -> list[Floats]:
    """Differentiate what effects change by their parameters in units of the fit, by differences.

    Args:
        parametrisation: Of their parameters.
        values: Their parameters in units of the fit, shape (parameters,).
        changed: Gives what parameters of each effect change, some arrays.
        here: What it gives for ``values``.
        size: Step of the differences.
        chosen: By which parameters, shape (parameters,); by all when left out.

    Returns:
        Arrays as of ``here`` with one more axis of the parameters; zero for choices between laws, and others.
    """
    slopes = [np.zeros((*one.shape, len(values))) for one in here]
    wanted = ~parametrisation.choices if chosen is None else chosen & ~parametrisation.choices
    for index in np.flatnonzero(wanted):
        moved = values.copy()
        step = -size if values[index] + size > parametrisation.upper[index] else size
        moved[index] += step
        for slope, ahead, one in zip(slopes, changed(parametrisation.split(moved)), here, strict=True):
            slope[..., index] = (ahead - one) / step
    return slopes


@dataclass(frozen=True)
class Parametrisation:
    """Parameters of several effects in units of the fit: over their typical size, or as logarithms."""

    parameters: tuple[ParameterSpec, ...]
    sizes: tuple[int, ...]

    @classmethod
    def of(cls, hypotheses: Sequence[Hypothesis]) -> "Parametrisation":
        """Parametrise by all parameters of some effects, one behind the other."""
        parameters = tuple(p for h in hypotheses for p in h.effect.parameters)
        return cls(parameters, tuple(len(h.effect.parameters) for h in hypotheses))

    def units(self, theta: Floats) -> Floats:
        """Convert parameters into units of the fit, shape (parameters,)."""
        return np.array([p.scaled(v) for p, v in zip(self.parameters, theta.tolist(), strict=True)])

    def split(self, values: Floats) -> list[Floats]:
        """Convert units of the fit into the parameters of each effect."""
        theta = np.array([p.value(v) for p, v in zip(self.parameters, values.tolist(), strict=True)])
        return [np.array(part) for part in np.split(theta, np.cumsum(self.sizes)[:-1])]

    def slopes(self, values: Floats) -> Floats:
        """Return the derivative of each parameter by its unit of the fit, shape (parameters,)."""
        return np.array([p.slope(v) for p, v in zip(self.parameters, values.tolist(), strict=True)])

    @property
    def lower(self) -> Floats:
        """Least values, shape (parameters,)."""
        return np.array([min(p.scaled(p.lower), p.scaled(p.upper)) for p in self.parameters])

    @property
    def upper(self) -> Floats:
        """Largest values, shape (parameters,)."""
        return np.array([max(p.scaled(p.lower), p.scaled(p.upper)) for p in self.parameters])

    @property
    def centres(self) -> Floats:
        """Middle of the priors, shape (parameters,)."""
        return np.array([0.0 if p.role == "amplitude" else p.scaled(p.typical) for p in self.parameters])

    @property
    def spreads(self) -> Floats:
        """Spread of the priors; that of an amplitude decides only where a shape makes up for any size."""
        spreads: Floats = np.maximum(np.array([_spread(p) for p in self.parameters]), 1e-3)
        return spreads

    def step(self, product: Floats, vector: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Return the normal equations of a step with the priors: the matrix and the right side.

        Args:
            product: M of the slopes by the parameters and then of the change.
            vector: b of the same.
            values: The parameters there, shape (parameters,).
        """
        prior = 1.0 / self.spreads**2
        pull: Floats = vector[:-1] - product[:-1, -1] - (values - self.centres) * prior
        return product[:-1, :-1] + np.diag(prior), pull

    def penalty(self, values: Floats) -> float:
        """Return the cost of values under their priors."""
        return float((((values - self.centres) / self.spreads)[~self.choices] ** 2).sum())

    @property
    def choices(self) -> NDArray[np.bool_]:
        """Which parameters are choices between laws, shape (parameters,)."""
        return np.array([bool(p.choices) for p in self.parameters])

    @property
    def amplitudes(self) -> NDArray[np.bool_]:
        """Which parameters are amplitudes, shape (parameters,)."""
        return np.array([p.role == "amplitude" for p in self.parameters])

    def at_bound(self, values: Floats) -> bool:
        """Return whether an amplitude is at a bound that is not its neutral value, nor that of rigidity."""
        rigid = np.array([p.transform == "inverse" for p in self.parameters], dtype=bool)
        near = np.minimum(np.where(rigid, np.inf, values - self.lower), self.upper - values) < 1e-6
        neutral = np.abs(values - self.centres) < 1e-6
        return bool((near & ~neutral & self.amplitudes).any())


def _spread(parameter: ParameterSpec) -> float:
    """Return the spread of a parameter's prior in units of the fit; none of a choice, which no fit moves."""
    if parameter.choices:
        return 0.0
    if parameter.transform == "log":
        return parameter.spread
    return (1.0 if parameter.role == "amplitude" else 3.0) * parameter.spread / parameter.scale

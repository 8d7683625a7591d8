"""Laws that the library does not state: whatever bends, pressures or neighbouring chambers might do.

A law is piecewise linear in what it depends on, sum_k c_k max(x - x_k, 0), with free coefficients; it states
no physics and so claims none. Where one explains far more than all effects that were accepted, for the price
of its coefficients, what was left out is not in the library, and the nearest name would be wrong.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import ChosenEffects
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.gaussian import Gaussian, Marginal
from softarm.estimator.diagnosis.judge import folds_of
from softarm.estimator.diagnosis.nominal import changed_prior, predictive
from softarm.estimator.diagnosis.normal_equations import NormalEquations, total
from softarm.estimator.diagnosis.probability import density, pseudo_bma
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.effects import describe
from softarm.estimator.specimen.physics import EffectName, Place

Columns = Callable[[Stage], Floats]

KNOTS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75])
"""Where a law may bend, as shares of the largest bend or pressure."""
BETTER = 1.15
SURE = 40.0
"""Factor and difference in the criterion by which a law must outdo the best that has a name."""
ALONE = 0.9
"""Share that it must explain of what all that were accepted explain: one law stands for one effect."""
ANY_SIZE = 100.0
"""Variance of a coefficient, over that with which it would explain all."""


@dataclass(frozen=True)
class FreeLaw:
    """What a law without a name explains.

    Args:
        place: Where it acts.
        regime: What it varies with.
        delta_bic: By how much it lowers the cost, less the penalty of its coefficients.
        nearest: Names of the effects that explain most, and far less.
    """

    place: Place
    regime: str
    delta_bic: float
    nearest: tuple[EffectName, ...] = ()

    def tell(self) -> str:
        """Describe what is seen, and how far the known effects fall short of it."""
        seen = f"Something that depends on the {self.regime} acts at {describe(self.place)}."
        if not self.nearest:
            return f"{seen} No known effect explains it."
        names = ", ".join(name.replace("_", " ") for name in self.nearest)
        return f"{seen} No known effect explains it; a free law fits far better than the closest, {names}."


def better_law(search: Search, choice: ChosenEffects) -> FreeLaw | None:
    """Give the law without a name that explains far more than what was accepted, if there is one."""
    best = max(laws(search), key=lambda law: law.delta_bic)
    fit = choice.fit
    if fit is None:
        return best if best.delta_bic > SURE else None
    strongest = max(one.candidate.delta_bic for one in choice.accepted)
    every = fit.gain - search.bic_penalty * sum(map(len, fit.thetas))
    nearest = tuple(hypothesis.name for hypothesis in fit.hypotheses)
    better = best.delta_bic > max(BETTER * strongest, ALONE * every) + SURE
    return replace(best, nearest=nearest) if better else None


def unnamed_probability(search: Search, changed: float) -> float:
    """Return how probable it is that what is missing has no name.

    The free laws, and a change of everything at once, compete with every effect that was fitted alone, and
    with nothing. Each is learnt from the other folds and predicts one. Beforehand the odds on them are those
    that a verdict asks for: a noise model that is too sure finds a little of any free law.

    Args:
        search: The search.
        changed: Twice the logarithm of the odds from which everything has changed.
    """
    fraction, size = search.weights.effective_sample_fraction, search.evidence.size
    plain = [part for part in search.parts(None) if not part.heldout]
    named = [
        density(one, search.predicted(one, None), search.bic_penalty)
        for key, one in search.tried.items()
        if len(key) == 1 and one is not None and not one.fit.at_bound
    ]
    nothing = [Marginal.cost_of(search.prior, total(fold, size), fraction) for fold in folds_of(plain)]
    known = [predictive(search.prior, fold, fraction, size) for fold in folds_of(plain)]
    wide = changed_prior(search.evidence, search.prior, search.width, plain, fraction)
    # What changes from run to run, a prior that allows for little learns as well.
    little = _log_densities(search.prior, plain, fraction) + 0.5 * changed / len(known)
    unnamed = [_log_densities(wide, plain, fraction) - little]
    for _, _, columns in _forms(search):
        parts, prior = _widened(search, columns)
        before = 0.5 * (np.array(known) + SURE / len(known))
        unnamed.append(_log_densities(prior, parts, fraction, search.prior) - before)
    alone = -0.5 * np.array(nothing)
    densities = [*named, *(alone + more for more in unnamed), alone]
    return float(pseudo_bma(np.column_stack(densities), search.rng)[len(named) : -1].sum())


def _log_densities(
    prior: Gaussian, parts: Sequence[NormalEquations], fraction: float, common: Gaussian | None = None
) -> Floats:
    """Return the logarithm of the density of each fold, given what the others teach, shape (folds,).

    Args:
        prior: Of all coefficients.
        parts: Normal equations of the searched stretches.
        fraction: Effective sample fraction: independent samples over samples.
        common: Prior of the first coefficients, where the others teach only the rest of them.
    """
    size, found = len(prior.mean), []
    for fold in folds_of(parts):
        learnt = prior.posterior(total([part for part in parts if part not in fold], size), fraction)
        if common is not None:
            learnt = learnt.with_first(common)
        found.append(0.5 * predictive(learnt, fold, fraction, size))
    return np.array(found)


def laws(search: Search) -> list[FreeLaw]:
    """Fit every law alone."""
    return [_fitted(search, columns, place, regime) for place, regime, columns in _forms(search)]


def _forms(search: Search) -> list[tuple[Place, str, Columns]]:
    """List the laws: where each acts, what it varies with, and its columns."""
    suspects = [stage for stage in search.evidence.stages if not stage.session.nominal]
    highest = max(float(stage.session.pressures.max(initial=0.0)) for stage in suspects)
    found: list[tuple[Place, str, Columns]] = []
    for index, segment in enumerate(suspects[0].world.segments):
        largest = max(float(bend(stage, index).max(initial=0.0)) for stage in suspects)
        own = partial(by_bend, segment=index, knots=KNOTS * largest)
        found.append((Place(segment=segment), "pose", own))
    alone = partial(by_pressure, knots=KNOTS[1:] * highest)
    together = partial(by_neighbours, highest=highest)
    return [*found, *((Place(), "pressure level", one) for one in (alone, together))]


def bend(stage: Stage, segment: int) -> Floats:
    """Give the size of a segment's bend [rad], shape (samples,)."""
    size: Floats = np.linalg.norm(stage.arm.baseline.strains[:, segment, :2], axis=-1)
    return size


def by_bend(stage: Stage, segment: int, knots: Floats) -> Floats:
    """Let a segment bend further in its own direction, shape (samples, rows, knots)."""
    size = bend(stage, segment)
    along = stage.arm.baseline.strains[:, segment, :2] / np.maximum(size, 1e-6)[:, None]
    slope = np.einsum("tra,ta->tr", stage.by_eigenstrain[..., 4 * segment : 4 * segment + 2], along)
    columns: Floats = slope[..., None] * np.maximum(size[:, None] - knots, 0.0)[:, None]
    return columns


def by_pressure(stage: Stage, knots: Floats) -> Floats:
    """Let every chamber push more from some pressure on, shape (samples, rows, knots)."""
    pressures = stage.session.pressures
    slopes = stage.input_jacobian[..., : pressures.shape[1]]
    columns: Floats = np.einsum("trc,tck->trk", slopes, np.maximum(pressures[..., None] - knots, 0.0))
    return columns


def by_neighbours(stage: Stage, highest: float) -> Floats:
    """Let chambers of a segment act on one another.

    For each segment: each chamber pushes more the fuller its neighbours are; or it takes from one neighbour
    what it gives the other.

    Returns:
        Shape (samples, rows, 2 segments).
    """
    pressures = stage.session.pressures
    slopes = stage.input_jacobian[..., : pressures.shape[1]]
    columns = []
    for index in range(len(stage.world.segments)):
        own = [c for c, segment in enumerate(stage.world.chamber_segment) if segment == index]
        inside = pressures[:, own]
        together = inside * (inside.sum(axis=1, keepdims=True) - inside) / max(highest, 1.0)
        around = np.roll(inside, 1, axis=1) - np.roll(inside, -1, axis=1)
        columns += [np.einsum("trc,tc->tr", slopes[..., own], change) for change in (together, around)]
    return np.stack(columns, axis=-1)


def _fitted(search: Search, columns: Columns, place: Place, regime: str) -> FreeLaw:
    """Fit the coefficients of a law to the searched stretches, beside what is common to all recordings."""
    parts, prior = _widened(search, columns)
    seen, fraction = total(parts, len(prior.mean)), search.weights.effective_sample_fraction
    before = Marginal.cost_of(search.prior, seen.first(search.evidence.size), fraction)
    gain = before - Marginal.cost_of(prior, seen, fraction)
    return FreeLaw(place, regime, gain - search.bic_penalty * (len(prior.mean) - search.evidence.size))


def _widened(search: Search, columns: Columns) -> tuple[list[NormalEquations], Gaussian]:
    """Return the normal equations of the searched stretches with a law's columns, and its wide prior."""
    parts = [part for part in search.evidence.widened(search.weights, columns) if not part.heldout]
    seen = total(parts, len(parts[0].vector))
    prior = search.prior
    for own_squares in np.diag(seen.matrix)[search.evidence.size :].tolist():
        prior = prior.augment(0.0, ANY_SIZE * seen.sum_of_squares / own_squares if own_squares > 0.0 else 1.0)
    return parts, prior

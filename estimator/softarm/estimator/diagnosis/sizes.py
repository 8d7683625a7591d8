"""How large chosen effects are, and how surely, where the model that predicts them errs itself.

The search weighs residuals by all that common coefficients might do, and so lives on the small differences
between an effect and these: right for distinguishing effects, wrong for their sizes. A model predicts the
shape of a change with errors, as it predicts motion, and an error in the regressor pulls an estimate towards
zero, the more so the more of what it shares with others is taken out (Griliches and Hausman, J. Econometrics
31 (1986) 93). Sizes are therefore those of ordinary least squares, with the common coefficients at what
nominal recordings teach and weights that do not depend on the residual, and on the model itself: what a
strong effect does to an arm that has moved, its linearisation gets wrong by a fixed share, and may by chance
fit as well.

How a sensor is mounted, offset, scaled or late is kinematics, so no error of its law pulls its size to zero.
Those sizes are of generalised least squares, with the common coefficients and the errors of the other
effects' laws marginalised: of all estimates that are linear in the readings it is the most certain (Aitken,
Proc. R. Soc. Edinburgh 55 (1936) 42).

Shapes, such as a time constant or a width, stay as the search found them. No share of a regressor scales
them, and least squares would lend them to what common coefficients do: a softening at large strains became
one at all strains, which a stiffness that differs a little resembles. Where a wall or a cord is, follows the
arm: it is fitted again, for the search sees the arm elsewhere, with the common coefficients that it finds.

Their covariance is that of this estimator and not that of its weights (Huber 1967; White, Econometrica 48
(1980) 817): with X the changes by each parameter, C the common columns and P the covariance of their
coefficients,

    H^-1 (X'X / fraction + X'C P C'X + sum X'd d'X) H^-1,    H = X'X,

where d is what the law of an effect may get wrong of its changes in one channel of one recording
(``law_error.py``); and, for a discrepancy that lasts for a recording, that of the estimates without one
recording each, or without a fifth of one where there are few (jackknife: Miller, Biometrika 61 (1974) 1). How
hard a wall is shows in how far it yields, a small part of what the arm would otherwise go into it, and so
does what the law of the contact leaves out: the deviations of walls and cords grow with the variance of what
is left (Birge, Phys. Rev. 40 (1932) 207).
The inverse of the covariance is the precision that the recordings give, to which the prior's is added
(Godambe, Ann. Math. Stat. 31 (1960) 1208): no shape is less certain than its prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.diagnosis.candidates import ChosenEffects, stated_alone
from softarm.estimator.diagnosis.choose import EXACT_STEPS, Search
from softarm.estimator.diagnosis.fit import (
    Fit,
    MarginalisedProblem,
    Parametrisation,
    RecordingResidual,
    fit_effects,
    slopes_of,
    whitened,
)
from softarm.estimator.diagnosis.judge import MATERIAL
from softarm.estimator.diagnosis.law_error import (
    beside_law_errors,
    gain_beside_law_errors,
    gradient_covariance,
)
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.effects import ParameterSpec
from softarm.estimator.specimen.physics import EffectName

Singles = NDArray[np.float32]

UNBIASED = 1e-3
"""Share of its prior precision that an estimate needs where no recording determines a parameter."""
DECIDES = 50.0
"""Gain in the criterion, beside the errors of the others' laws, from which an effect is none of them.

Of 14 weaker effects that acted in trials of two simulators 13 gained 58 and more; of 7 that did not 5 gained
43 and less, and two, creep beside a law of softening that errs less now, 66 and more.
"""
FEW, SPANS = 5, 5
"""Recordings below which they are few, and the spans of each that are then left out in turn."""


@dataclass(frozen=True)
class Part:
    """What one recording, or a span of it, states about the parameters at the estimate.

    Args:
        matrix: X'X, shape (parameters, parameters).
        vector: X'r, with r what the effects leave, shape (parameters,).
        cross: X'C, shape (parameters, columns).
    """

    matrix: Floats
    vector: Floats
    cross: Floats


def knows_common(search: Search) -> bool:
    """Return whether the common coefficients are known apart from the effects."""
    return search.evidence.has_nominal and search.natural_frequency is None


def sized(search: Search, fit: Fit) -> Fit:
    """Estimate the sizes of chosen effects anew, with their uncertainty.

    Without nominal recordings the common coefficients are not known apart from the effects; then, and where a
    natural frequency was measured, they stay as the search found them.

    Args:
        search: The search that chose them.
        fit: The effects, as it fitted them.
    """
    return with_arm_sized(search, with_sensors_sized(search, fit)) if knows_common(search) else fit


def with_arm_sized(search: Search, fit: Fit) -> Fit:
    """Estimate the sizes of what acts on the arm by ordinary least squares, with their covariance.

    Args:
        search: The search that chose the effects.
        fit: The effects; those on sensors stay as they are.
    """
    of_arm = _on_arm(fit)
    if not of_arm.any():
        return fit
    residuals, columns = plain_residuals(search)
    problem = MarginalisedProblem.alone(residuals, search.weights.effective_sample_fraction)
    moving = of_arm & np.array([_is_sized(h, p) for h in fit.hypotheses for p in h.effect.parameters])
    found = fit_effects(problem, fit.hypotheses, fit.thetas, moving=moving)
    if search.solvable(fit, answering=True):
        again = fit_effects(
            problem, found.hypotheses, found.thetas, exact=True, iterations=EXACT_STEPS, moving=moving
        )
        found = again if again.gain > (1.0 - MATERIAL) * found.gain else found
    parametrisation = Parametrisation.of(found.hypotheses)
    values = parametrisation.units(np.concatenate(found.thetas))
    left = whitened(problem, found.hypotheses, found.thetas, exact=found.exact)
    slopes = slopes_of(
        problem, found.hypotheses, parametrisation, values, left, exact=found.exact, chosen=of_arm
    )
    parts = [
        part
        for recorded, slope, change, common in zip(residuals, slopes, left, columns, strict=True)
        for part in _parts(
            recorded,
            slope[:, of_arm],
            recorded.residual.ravel() - change[:, 0],
            common,
            whole=len(residuals) >= FEW,
        )
    ]
    prior = 1.0 / parametrisation.spreads[of_arm] ** 2
    fraction = search.weights.effective_sample_fraction
    own = np.ix_(of_arm, of_arm)
    law_errors = gradient_covariance(problem, found, slopes)[own]
    spread = robust_covariance(
        parts, UNBIASED * prior / fraction, search.prior.covariance, law_errors, fraction
    )
    wider = contact_deviations(found, _left_variance(residuals, left))[of_arm]
    spread *= np.outer(wider, wider)
    covariance = fit.covariance * np.outer(~of_arm, ~of_arm)
    covariance[own] = np.linalg.inv(np.linalg.inv(spread) + np.diag(prior))
    if reversed_sign(fit, found):
        return replace(fit, covariance=covariance)
    return replace(found, covariance=covariance, gain=fit.gain)


def with_sensors_sized(search: Search, fit: Fit) -> Fit:
    """Estimate the sizes of what sensors do by generalised least squares, with their covariance.

    Args:
        search: The search that chose the effects.
        fit: The effects, as it fitted them; those on the arm stay.
    """
    of_arm = _on_arm(fit)
    if of_arm.all() or not of_arm.any():
        return fit
    parametrisation = Parametrisation.of(fit.hypotheses)
    problem, values = search.problem(), parametrisation.units(np.concatenate(fit.thetas))
    change = whitened(problem, fit.hypotheses, fit.thetas, exact=fit.exact)
    slopes = slopes_of(problem, fit.hypotheses, parametrisation, values, change, exact=fit.exact)
    columns = [np.column_stack(both) for both in zip(slopes, change, strict=True)]
    erring = [number for number, hypothesis in enumerate(fit.hypotheses) if _acts_on_arm(hypothesis)]
    matrix, pull = parametrisation.step(*beside_law_errors(problem, columns, fit, erring), values)
    covariance = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    moved = values + np.where(of_arm, 0.0, covariance @ pull)
    thetas = parametrisation.split(np.clip(moved, parametrisation.lower, parametrisation.upper))
    return replace(fit, thetas=tuple(thetas), covariance=covariance)


def contact_deviations(fit: Fit, left_variance: float) -> Floats:
    """Return by how much the deviations of parameters grow: of walls and cords, where much is left.

    Args:
        fit: The effects.
        left_variance: Variance of what they leave, over that of the noise.

    Returns:
        Shape (parameters,).
    """
    contacts = [h.effect.responds_to_own_effect for h in fit.hypotheses]
    of_contacts = np.repeat(contacts, [len(theta) for theta in fit.thetas])
    return np.where(of_contacts, np.sqrt(max(left_variance, 1.0)), 1.0)


def _left_variance(residuals: Sequence[RecordingResidual], changes: Sequence[Floats]) -> float:
    """Return the variance of what effects leave, over that of the noise."""
    squares = sum(
        float(((recorded.residual.ravel() - change[:, 0]) ** 2).sum())
        for recorded, change in zip(residuals, changes, strict=True)
    )
    return squares / sum(np.count_nonzero(recorded.weight) for recorded in residuals)


def _on_arm(fit: Fit) -> Flags:
    """Return which parameters are of effects on the arm, shape (parameters,)."""
    return np.repeat([_acts_on_arm(h) for h in fit.hypotheses], [len(theta) for theta in fit.thetas])


def _acts_on_arm(hypothesis: Hypothesis) -> bool:
    """Return whether an effect is one of the arm, and none of a sensor."""
    return hypothesis.effect.hook != "sensing"


def _is_sized(hypothesis: Hypothesis, parameter: ParameterSpec) -> bool:
    """Return whether least squares fits a parameter: an amplitude, or where the arm touches something."""
    return parameter.role == "amplitude" or hypothesis.effect.responds_to_own_effect


def reversed_sign(fit: Fit, other: Fit) -> bool:
    """Return whether some effect acts the other way in another fit: then that is no estimate of its size."""
    for hypothesis, own, theirs in zip(fit.hypotheses, fit.thetas, other.thetas, strict=True):
        sizes = np.array(
            [p.spread if p.role == "amplitude" else np.inf for p in hypothesis.effect.parameters]
        )
        if float(np.sum(own * theirs / sizes**2)) < 0.0:
            return True
    return False


def without_fragments(
    search: Search, choice: ChosenEffects
) -> tuple[ChosenEffects, Fit | None, list[EffectName]]:
    """Take back effects that may be what the laws of the others leave, and estimate all sizes.

    Where an effect then states no more than a plainer one, that one is left of it. Without nominal recordings
    all effects and their sizes stay as the search found them; see ``sized``.

    Returns:
        What is left of the choice, its sizes, and the names of what was taken back.
    """
    dropped: list[EffectName] = []
    if not knows_common(search):
        return choice, choice.fit, dropped
    while choice.fit is not None and (lost := fragments(search, choice.fit)):
        weakest = min(lost, key=lambda k: lost[k])
        dropped.append(choice.fit.hypotheses[weakest].name)
        choice = search.without(choice, [weakest])
    while choice.fit is not None:
        sizes = sized(search, choice.fit)
        plain = plainer(search, choice, sizes)
        if plain is None:
            return choice, sizes, dropped
        choice = plain
    return choice, None, dropped


def plainer(search: Search, choice: ChosenEffects, sizes: Fit) -> ChosenEffects | None:
    """Replace an effect that states no more than a plainer one by that one; ``None`` where none does.

    The search distinguishes a leak behind a narrow line from the line's lag by little of what either
    explains, with the sureness of its noise model. Here the honest deviations decide if any leak is left.
    """
    fit = choice.fit
    assert fit is not None
    for number in range(len(choice.accepted)):
        plain = stated_alone(sizes, number)
        if plain is None:
            continue
        name, size = plain
        index = search.evidence.library.index_of(name, fit.hypotheses[number].place)
        if index is None:
            continue
        rest = search.subset(fit, [k for k in range(len(fit.thetas)) if k != number])
        candidate = search.candidate(index, np.array([size]), search.left_free(rest).problem(), rest)
        if candidate is None:
            continue
        return search.exchanged(choice, number, candidate)
    return None


def fragments(search: Search, fit: Fit) -> dict[int, float]:
    """Find effects that may be what the laws of the others leave, or what another one states.

    Beside the errors of all other laws, or fitted again without it, they gain less than ``DECIDES``. What an
    effect gained before the others were known does not count here: a payload may first have been taken for a
    denser arm. Nor does it matter which gains more: where a stiffer segment stretches more than its law
    predicts, a force along the arm gained more than the stiffness, which the force had taken the most of.

    How a sensor is mounted, scaled or late changes its own readings alone, so that its law leaves nothing for
    effects on the arm or on other sensors to explain.

    Args:
        search: The search that chose them.
        fit: The effects, as it fitted them.

    Returns:
        What each of them gains, by its number.
    """
    weighed = [
        number
        for number, own in enumerate(fit.hypotheses)
        if any(h.place.sensor in (None, own.place.sensor) for h in fit.hypotheses if h is not own)
    ]
    if not weighed:
        return {}
    problem, found = search.problem(), {}
    for number in weighed:
        beside = gain_beside_law_errors(problem, fit, number)
        price = search.bic_penalty * fit.hypotheses[number].effect.degrees_of_freedom
        least = min(search.contribution(fit, number), beside - price)
        if least < DECIDES:
            found[number] = least
    return found


def plain_residuals(search: Search) -> tuple[list[RecordingResidual], list[Singles]]:
    """List what least squares sees of each recording in question: searched stretches, over their noise.

    Returns:
        The residuals, with the common coefficients at their prior mean; and the common columns over the
        noise, each of shape (samples * rows, columns).
    """
    residuals: list[RecordingResidual] = []
    columns: list[Singles] = []
    mean = search.prior.mean
    for number, stage in enumerate(search.evidence.stages):
        session = stage.session
        if session.nominal or session.heldout.all():
            continue
        residual = search.evidence.residuals[number]
        scale = search.weights.stds(search.evidence.names[number])
        used = np.isfinite(residual) & ~session.heldout[:, None]
        weight = used / stage.error_std(scale)
        own = search.evidence.columns[number]
        left = np.nan_to_num(residual - own @ mean) * weight
        blank = np.zeros((np.count_nonzero(weight), 1), dtype=np.float32)
        residuals.append(RecordingResidual(stage, left, weight, blank))
        columns.append((own * weight[..., None].astype(np.float32)).reshape(left.size, -1))
    return residuals, columns


def _parts(
    recorded: RecordingResidual, slope: Floats, residual: Floats, common: Singles, *, whole: bool
) -> list[Part]:
    """Multiply out a recording, or spans of it where there are few recordings."""
    samples, rows = recorded.residual.shape
    cuts = np.array_split(np.arange(samples), 1 if whole else SPANS)
    found = []
    for cut in cuts:
        own = slice(int(cut[0]) * rows, (int(cut[-1]) + 1) * rows)
        x, c = slope[own], common[own]
        found.append(
            Part(x.T @ x, x.T @ residual[own], np.asarray(x.astype(np.float32).T @ c, dtype=np.float64))
        )
    return found


def robust_covariance(
    parts: Sequence[Part], prior: Floats, common: Floats, law_errors: Floats, fraction: float
) -> Floats:
    """Compute the covariance of least squares under errors that its weights do not know of.

    Args:
        parts: What each recording contributes, at the estimate.
        prior: Prior precision of each parameter, over the fraction, shape (parameters,).
        common: Covariance of the common coefficients, shape (columns, columns).
        law_errors: Covariance of the gradient by the errors of laws, shape (parameters, parameters).
        fraction: Effective sample fraction: independent samples over samples.
    """
    whole = sum((part.matrix for part in parts), np.zeros((len(prior), len(prior))))
    cross = sum((part.cross for part in parts), np.zeros((len(prior), len(common))))
    inverse = np.linalg.inv(whole + np.diag(prior))
    independent = (whole + np.diag(prior)) / fraction
    sandwich = inverse @ (independent + cross @ common @ cross.T + law_errors) @ inverse
    pull = sum((part.vector for part in parts), np.zeros(len(prior)))
    moved = []
    for part in parts:
        rest = whole - part.matrix + np.diag(prior)
        moved.append(np.linalg.solve(rest, pull - part.vector) - inverse @ pull)
    scatter = np.array(moved) - np.mean(moved, axis=0)
    jackknife = (len(parts) - 1) / len(parts) * scatter.T @ scatter
    covariance: Floats = sandwich + jackknife
    return covariance

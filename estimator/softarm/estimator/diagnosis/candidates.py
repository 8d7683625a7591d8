"""Hypotheses after their fits, and what was accepted of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import gammainccinv, ndtr

from softarm.estimator.diagnosis.fit import Fit, Parametrisation
from softarm.estimator.diagnosis.judge import Judgement
from softarm.estimator.effects.effect import ParameterSpec
from softarm.estimator.specimen.physics import EffectName

ALIKE = 4.0
ALIKE_SHARE = 0.01
"""Difference in the criterion, or its share of the best, within which the plainer of two is taken."""
MOST_SURPRISE = 12.0
"""Largest cost of a size that nobody expects."""
SIGNIFICANT_Z = 3.0
"""Size of an amplitude over its standard deviation from which it is significant."""


def alike_within(gain: float) -> float:
    """Return by how much less than a gain the plainer of two may gain; see ``ALIKE``."""
    return max(ALIKE, ALIKE_SHARE * gain)


@dataclass(frozen=True)
class Candidate:
    """A hypothesis after its fit.

    Args:
        number: Its number in the library.
        fit: The fit, together with the effects accepted before.
        delta_bic: By how much it lowers the cost, less the penalty of its parameters and of a size that
            nobody expects. A natural frequency is left out of it: it distinguishes effects that explain what
            was measured, and by itself shows none.
    """

    number: int
    fit: Fit
    delta_bic: float

    @property
    def degrees_of_freedom(self) -> int:
        """Number of its own parameters that were fitted."""
        return self.fit.hypotheses[-1].effect.degrees_of_freedom


@dataclass(frozen=True)
class Accepted:
    """An accepted effect with its rivals.

    Args:
        candidate: The effect as it was chosen.
        judgement: What spoke for it.
        field: All finalists of its round, the best first.
    """

    candidate: Candidate
    judgement: Judgement
    field: tuple[Candidate, ...]


@dataclass(frozen=True)
class ChosenEffects:
    """The end of the search.

    Args:
        accepted: What was accepted, in the order of acceptance.
        fit: Joint fit of all; ``None`` where nothing was accepted.
        alarm_p: Chance of the best hypothesis' gain where nothing is missing.
        turned_down: The best candidate of the last round and why it failed, where there was one.
    """

    accepted: tuple[Accepted, ...]
    fit: Fit | None
    alarm_p: float
    turned_down: tuple[Candidate, Judgement] | None


def plainest_first(field: list[Candidate]) -> list[Candidate]:
    """Put the one with the fewest and likeliest numbers first among those as good as the best."""
    if not field:
        return field
    margin = alike_within(field[0].delta_bic)
    alike = [one for one in field if one.delta_bic > field[0].delta_bic - margin]

    def plain(one: Candidate) -> tuple[int, float]:
        return len(one.fit.thetas[-1]), surprise(one.fit)

    return [*sorted(alike, key=plain), *field[len(alike) :]]


def surprise(fit: Fit) -> float:
    """Return how unlikely the sizes of a fit's last effect are under their priors, as a cost."""
    sizes = [
        (value / parameter.spread) ** 2
        for parameter, value in zip(
            fit.hypotheses[-1].effect.parameters, fit.thetas[-1].tolist(), strict=True
        )
        if parameter.role == "amplitude"
    ]
    return float(min(sum(sizes), MOST_SURPRISE))


def is_moved(fit: Fit, number: int, alone: Fit) -> bool:
    """Return whether the size of an effect has moved by more than its deviation since it was accepted.

    Args:
        fit: All effects.
        number: The effect.
        alone: Its fit then, beside those that were accepted before it.
    """
    parametrisation = Parametrisation.of((fit.hypotheses[number],))
    sizes = parametrisation.amplitudes
    moved = parametrisation.units(fit.thetas[number]) - parametrisation.units(alone.thetas[-1])
    return bool((np.abs(moved) > alone.scaled_stds(len(alone.thetas) - 1))[sizes].any())


def is_distinguishable(fit: Fit, number: int) -> bool:
    """Return whether an effect is as clear of zero as an amplitude of ``SIGNIFICANT_Z`` deviations.

    At a given shape an effect is linear in its amplitudes a, and with none of them it has no shape. So twice
    the logarithm of the likelihood ratio is a' C^-1 a, with C their covariance at the shape that was fitted,
    however unsure shape and amplitude are together: what a law says at a bend of one radian is uncertain if
    its exponent is free, and may be certain at the bends that were recorded. It is compared with what as many
    parameters as the law has gain by chance (Wilks 1938). Of what may be rigid, none is the softest.
    """
    effect, theta = fit.hypotheses[number].effect, fit.thetas[number]
    covariance = fit.scaled_covariance(number)
    size = np.array([p.role == "amplitude" for p in effect.parameters])
    values = np.array(
        [
            p.scaled(value) - (p.scaled(p.lower) if p.transform == "inverse" else 0.0)
            for p, value in zip(effect.parameters, theta.tolist(), strict=True)
        ]
    )
    precision = np.linalg.inv(covariance)[np.ix_(size, size)]
    ratio = float(values[size] @ precision @ values[size])
    # A quantile of chi-square.
    by_chance = 2.0 * float(gammainccinv(0.5 * effect.degrees_of_freedom, 2.0 * ndtr(-SIGNIFICANT_Z)))
    return ratio >= by_chance


def includes(richer: Fit, plain: Fit) -> bool:
    """Return whether a fitted law states another one at its place: as a part distinguishable from zero."""
    hypothesis, other = richer.hypotheses[-1], plain.hypotheses[-1]
    for parameter, value, significant in _parts(richer):
        if parameter.alone == other.name and hypothesis.place == other.place:
            return significant and value * float(plain.thetas[-1][0]) > 0.0
    return False


def restates(richer: Fit, plain: Fit) -> bool:
    """Return whether a fitted law states a plainer one and nothing else that is distinguishable from zero."""
    name = plain.hypotheses[-1].name
    return includes(richer, plain) and not any(
        significant
        for parameter, _, significant in _parts(richer)
        if parameter.role == "amplitude" and parameter.alone != name
    )


def stated_alone(fit: Fit, number: int) -> tuple[EffectName, float] | None:
    """Return the plainer effect, and its size, that is all that an effect of a fit states by its deviations.

    ``None`` where it states more, or something else.
    """
    stated = [(p, v) for p, v, significant in _parts(fit, number) if p.role == "amplitude" and significant]
    alone = stated[0][0].alone if len(stated) == 1 else None
    return None if alone is None else (alone, stated[0][1])


def _parts(fit: Fit, number: int | None = None) -> Iterator[tuple[ParameterSpec, float, bool]]:
    """Yield each parameter of an effect, by default the last, its value, and whether that is significant."""
    number = len(fit.hypotheses) - 1 if number is None else number
    parameters = fit.hypotheses[number].effect.parameters
    stds = fit.scaled_stds(number).tolist()
    for parameter, value, std in zip(parameters, fit.thetas[number].tolist(), stds, strict=True):
        yield parameter, value, bool(abs(parameter.scaled(value)) >= SIGNIFICANT_Z * std)

"""Hypotheses after their fits, and what was accepted of them."""

from dataclasses import dataclass

from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.judge import Judgement

ALIKE = 4.0
ALIKE_SHARE = 0.01
"""Difference in the criterion, or its share of the best, within which the plainer of two is taken."""
MOST_SURPRISE = 12.0
"""Largest cost of a size that nobody expects."""
TOLD = 3.0
"""Size of an amplitude over its standard deviation from which it is significant."""


@dataclass(frozen=True)
class Candidate:
    """A hypothesis after its fit.

    Args:
        number: Its number in the library.
        fit: The fit, together with the effects accepted before.
        gain: By how much it lowers the cost.
        delta_bic: The same less the penalty of its parameters and of a size that nobody expects.
    """

    number: int
    fit: Fit
    gain: float
    delta_bic: float


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
    margin = max(ALIKE, ALIKE_SHARE * field[0].delta_bic)
    alike = [one for one in field if one.delta_bic > field[0].delta_bic - margin]

    def plain(one: Candidate) -> tuple[int, float]:
        return len(one.fit.thetas[-1]), surprise(one.fit)

    return [*sorted(alike, key=plain), *field[len(alike) :]]


def surprise(fit: Fit) -> float:
    """Give how unlikely the sizes of a fit's last effect are beforehand, as a cost."""
    sizes = [
        (value / parameter.spread) ** 2
        for parameter, value in zip(
            fit.hypotheses[-1].effect.parameters, fit.thetas[-1].tolist(), strict=True
        )
        if parameter.role == "amplitude"
    ]
    return float(min(sum(sizes), MOST_SURPRISE))


def is_distinguishable(fit: Fit, number: int) -> bool:
    """Return whether some amplitude differs significantly from zero, or from what may be rigid."""
    effect, theta, stds = fit.hypotheses[number].effect, fit.thetas[number], fit.scaled_stds(number)
    sizes = []
    for parameter, value, std in zip(effect.parameters, theta.tolist(), stds.tolist(), strict=True):
        if parameter.role == "amplitude":
            none = parameter.scaled(parameter.lower) if parameter.transform == "inverse" else 0.0
            sizes.append(abs(parameter.scaled(value) - none) / max(std, 1e-300))
    return bool(max(sizes) >= TOLD)


def includes(richer: Fit, plain: Fit) -> bool:
    """Return whether a fitted law states another one at its place: as a part distinguishable from zero."""
    hypothesis, other = richer.hypotheses[-1], plain.hypotheses[-1]
    amplitudes = zip(
        hypothesis.effect.parameters,
        richer.thetas[-1].tolist(),
        richer.scaled_stds(len(richer.hypotheses) - 1).tolist(),
        strict=True,
    )
    for parameter, value, std in amplitudes:
        name, sign = parameter.alone or ("", 0.0)
        if name == other.name and hypothesis.place == other.place:
            alike = sign * value * float(plain.thetas[-1][0]) > 0.0
            return alike and bool(abs(parameter.scaled(value)) >= TOLD * std)
    return False

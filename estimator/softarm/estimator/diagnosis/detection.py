"""How large an effect would have to be to be found in some recordings.

An effect of amplitude a, alone, lowers the cost by a noncentral chi-square of noncentrality a^2 M, with M the
information that the searched stretches hold on its amplitude once all that is common to the recordings is
integrated out. It is named where this gain pays for its parameters and for a size that nobody expects, with
the least gain of a name to spare, exceeds what the search finds in 99 % of recordings without any effect, and
is material. With G the largest of these, sqrt(gain) scatters about a sqrt(M) by at most 1, so

    a = (sqrt(G) + 1.28) / sqrt(M)

is found in nine of ten recordings. All is to first order in the effect.
"""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.diagnosis.candidates import MOST_SURPRISE
from softarm.estimator.diagnosis.choose import LEAST_BIC, Search
from softarm.estimator.diagnosis.judge import FALSE_ALARM, MATERIAL, least_explainable
from softarm.estimator.diagnosis.result import DetectionLimit
from softarm.estimator.diagnosis.screen import INVISIBLE, null_scores

POWER = 1.2816
"""Quantile of a standard normal below which nine of ten lie."""


def detection_limits(search: Search) -> tuple[DetectionLimit, ...]:
    """Compute the limit of every amplitude of every effect at every place, the median over its shapes.

    Args:
        search: The search whose rules decide.

    Returns:
        Those that have a limit within the bounds of their parameter.
    """
    evidence, library = search.evidence, search.evidence.library
    marginal = search.left(None).marginal
    # A generator of its own: the limits must not change what is drawn after them.
    null = null_scores(evidence, marginal, np.random.default_rng(0))
    chance = float(np.quantile(null, 1.0 - FALSE_ALARM))
    explainable = least_explainable(marginal.cost, marginal.count)
    sizes: dict[tuple[int, int], list[float]] = {}
    for column, direction in enumerate(library.directions):
        if direction.parameter < 0:
            continue
        effect = library.hypotheses[direction.hypothesis].effect
        column_index = evidence.nuisances + column
        least = required_gain(search.bic_penalty, effect.degrees_of_freedom, chance, explainable)
        spread = effect.parameters[direction.parameter].spread / direction.typical
        size = limit(float(marginal.matrix[column_index, column_index]), least, spread) * direction.typical
        sizes.setdefault((direction.hypothesis, direction.parameter), []).append(size)
    return tuple(
        DetectionLimit(
            hypothesis.name, place, effect.reported(parameter, place), size, effect.unit(parameter, place)
        )
        for (number, index), own_sizes in sizes.items()
        for hypothesis in (library.hypotheses[number],)
        for effect, place in ((hypothesis.effect, hypothesis.place),)
        for parameter in (effect.parameters[index],)
        for size in (float(np.median(own_sizes)),)
        if size <= max(abs(parameter.lower), abs(parameter.upper))
    )


def required_gain(bic_penalty: float, parameters: int, chance: float, explainable: float) -> float:
    """Compute the gain in cost from which an effect is accepted, whatever its size is expected to be.

    Args:
        bic_penalty: What each parameter costs.
        parameters: Number of parameters.
        chance: Score, after the penalty, that 99 % of searches without any effect stay below.
        explainable: What counts as explainable at least.
    """
    return max(max(LEAST_BIC, chance) + bic_penalty * parameters, MATERIAL * explainable)


def limit(information: float, gain: float, spread: float) -> float:
    """Compute the amplitude that is found in nine of ten recordings.

    Args:
        information: M.
        gain: The gain that is required beside the penalty of a surprising size.
        spread: Standard deviation of the amplitude's prior.
    """
    if information <= INVISIBLE:
        return np.inf
    least, most = ((np.sqrt(gain + more) + POWER) / np.sqrt(information) for more in (0.0, MOST_SURPRISE))
    for _ in range(50):  # the penalty of a size grows with it, so halving finds where the two agree
        middle = 0.5 * (least + most)
        surprise = min((middle / spread) ** 2, MOST_SURPRISE)
        enough = middle * np.sqrt(information) >= np.sqrt(gain + surprise) + POWER
        least, most = (least, middle) if enough else (middle, most)
    return float(most)


def by_effect(limits: Sequence[DetectionLimit]) -> list[DetectionLimit]:
    """Keep the largest limit of each amplitude and unit: beyond it the effect is found wherever it acts."""
    largest: dict[tuple[str, str, str], DetectionLimit] = {}
    for one in limits:
        key = (one.effect, one.parameter, one.unit)
        if key not in largest or one.size > largest[key].size:
            largest[key] = one
    return list(largest.values())

"""How probable each explanation of a mismatch is, by what it predicts where it was not fitted.

The odds of a noise model are far too sure of themselves as soon as every explanation is a little wrong. How
much of that sureness is real shows in how the folds of the recordings differ: each explanation is weighted by
its predictions of folds that are themselves weighted at random (pseudo-BMA+: Yao, Vehtari, Simpson and
Gelman, Bayesian Anal. 13 (2018) 917, section 3.4).
"""

from collections.abc import Mapping

import numpy as np
from scipy.special import softmax

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import ChosenEffects
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.specimen.physics import EffectName, Place

Explanation = tuple[EffectName, Place]

CREDIBLE = 0.95
"""Probability, together, of the explanations that data cannot distinguish: the convention for intervals."""
DRAWS = 2000
"""Random weightings of the folds: a probability is then good to a hundredth."""


def probabilities(search: Search, choice: ChosenEffects, index: int) -> Mapping[Explanation, float]:
    """Return how probable it is that each of some effects explains what the other findings leave.

    That none of them does is one more explanation; what the other findings say competes with none.

    Args:
        search: The search.
        choice: What it accepted.
        index: Number of the accepted effect whose rivals are weighed.
    """
    fit, accepted = choice.fit, choice.accepted[index]
    assert fit is not None
    others = [k for k in range(len(fit.thetas)) if k != index]
    taken = {choice.accepted[k].candidate.number for k in others}
    field = [one for one in accepted.field if one.number not in taken]
    rest = search.subset(fit, others)
    costs = [search.predicted(candidate, rest) for candidate in field]
    fitted = [2.0 * (len(one.fit.thetas[-1]) - 1) / len(costs[0].before) for one in field]
    densities = [-0.5 * (own.after + spent) for own, spent in zip(costs, fitted, strict=True)]
    weights = pseudo_bma(np.column_stack([*densities, -0.5 * costs[0].before]), search.rng)
    found: dict[Explanation, float] = {}
    for one, weight in zip(field, weights.tolist(), strict=False):
        hypothesis = search.evidence.library.hypotheses[one.number]
        key = (hypothesis.name, hypothesis.place)
        found[key] = found.get(key, 0.0) + weight
    return found


def pseudo_bma(densities: Floats, rng: np.random.Generator) -> Floats:
    """Return the weights of explanations by Bayesian bootstrap over folds, shape (explanations,).

    Args:
        densities: Logarithm of the density with which each explanation predicts each fold that it was not
            fitted to, shape (folds, explanations).
        rng: Of the weightings of the folds.
    """
    folds = len(densities)
    weightings = folds * rng.dirichlet(np.ones(folds), DRAWS)
    return np.asarray(softmax(weightings @ densities, axis=1).mean(axis=0))


def credible_set(probable: Mapping[Explanation, float]) -> set[Explanation]:
    """Return the fewest explanations that together are credible, the likeliest first."""
    found: set[Explanation] = set()
    reached = 0.0
    for explanation, weight in sorted(probable.items(), key=lambda entry: -entry[1]):
        if reached >= CREDIBLE:
            break
        found.add(explanation)
        reached += weight
    return found

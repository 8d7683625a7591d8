"""How probable each explanation of a mismatch is, by what it explains of each recording.

The odds of a noise model are far too sure of themselves as soon as every explanation is a little wrong. How
much of that sureness is real shows in how the folds of the recordings differ (Vuong, Econometrica 57 (1989)
307): each explanation is weighted by its density of folds that are themselves weighted at random
(pseudo-BMA+: Yao, Vehtari, Simpson and Gelman, Bayesian Anal. 13 (2018) 917, section 3.4).

What one law gets wrong of a strong effect, all folds agree on. So the densities of candidates count with a
power a / (a + g), g the gain of the best, as for data that are only known to be close to their law (coarsened
posterior: Miller and Dunson, J. Am. Stat. Assoc. 114 (2019) 1113): no sureness comes from a hundredth of it.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import softmax

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import ALIKE, ALIKE_SHARE, Candidate, surprise
from softarm.estimator.diagnosis.judge import FoldCosts
from softarm.estimator.specimen.physics import EffectName, Place

Explanation = tuple[EffectName, Place]

CREDIBLE = 0.95
"""Probability, together, of the explanations that data cannot distinguish: the convention for intervals."""
BARE = 3.2
"""Odds that are not worth more than a bare mention (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773)."""
COARSE = ALIKE / ALIKE_SHARE
"""Gain in cost at which densities count with half their power, a."""
DRAWS = 2000
"""Random weightings of the folds: a probability is then good to a hundredth."""


def probabilities(
    candidates: Sequence[Candidate], costs: Sequence[FoldCosts], bic_penalty: float, rng: np.random.Generator
) -> Floats:
    """Return how probable each of some candidates is, shape (candidates,); the rest is that none acts.

    What every arm may have of a candidate explains something before any change does, so candidates, and none,
    are compared by both together.

    Args:
        candidates: What was fitted, at least one.
        costs: What each of them explains of the folds.
        bic_penalty: Cost of a parameter.
        rng: Of the weightings of the folds.
    """
    both = list(zip(candidates, costs, strict=True))
    found = [density(one, own, bic_penalty) + 0.5 * own.usual for one, own in both]
    # Without a change, an arm may have some of one of them as usual: its shape was fitted as well.
    shapes = [bic_penalty * (one.degrees_of_freedom - 1) for one in candidates]
    usual = [0.5 * (own.usual - cost / len(own.usual)) for own, cost in zip(costs, shapes, strict=True)]
    none = max([np.zeros_like(found[0]), *usual], key=lambda before: float(before.sum()))
    densities = np.column_stack([*found, none])
    gain = max(2.0 * float((densities.sum(axis=0) - none.sum()).max()), 0.0)
    return pseudo_bma(densities * COARSE / (COARSE + gain), rng)[:-1]


def groups_of_alike(candidates: Sequence[Candidate]) -> NDArray[np.int_]:
    """Return which group of candidates that the recordings fit alike each one is of, shape (candidates,).

    They are of one structural class: a lost gain is a leak that has reached its end at once. Where the
    recordings fit both alike, the one with fewer parameters is simpler, but nothing makes it likelier.
    """
    gains = np.array([one.fit.gain for one in candidates])
    classes = [frozenset(one.fit.hypotheses[-1].effect.equivalence) for one in candidates]
    related = np.array([[bool(own & other) for other in classes] for own in classes])
    alike = (np.abs(gains[:, None] - gains) < ALIKE) & related
    return np.asarray(connected_components(alike, directed=False)[1], dtype=np.int_)


def shared(weights: Floats, groups: NDArray[np.int_]) -> Floats:
    """Share probability within each group, shape (candidates,)."""
    each: Floats = (np.bincount(groups, weights) / np.bincount(groups))[groups]
    return each


def density(candidate: Candidate, costs: FoldCosts, bic_penalty: float) -> Floats:
    """Return the logarithm of the density of each fold under a candidate, over that without its change.

    What nominal recordings have of it is in both.
    """
    price = spent(candidate, bic_penalty) - costs.frequency_gain
    return 0.5 * (costs.gains - price / len(costs.gains))


def spent(candidate: Candidate, bic_penalty: float) -> float:
    """Return what a candidate's parameters cost: all folds have fitted them, and their size may surprise."""
    return bic_penalty * candidate.degrees_of_freedom + surprise(candidate.fit)


def pseudo_bma(densities: Floats, rng: np.random.Generator) -> Floats:
    """Return the weights of explanations by Bayesian bootstrap over folds, shape (explanations,).

    Args:
        densities: Logarithm of the density of each fold under each explanation, up to a term that all share,
            shape (folds, explanations).
        rng: Of the weightings of the folds.
    """
    folds = len(densities)
    weightings = folds * rng.dirichlet(np.ones(folds), DRAWS)
    return np.asarray(softmax(weightings @ densities, axis=1).mean(axis=0))


def credible_set(probable: Mapping[Explanation, float]) -> set[Explanation]:
    """Return the fewest explanations that together are credible, the likeliest first."""
    credible: set[Explanation] = set()
    reached = 0.0
    for explanation, weight in sorted(probable.items(), key=lambda entry: -entry[1]):
        if reached >= CREDIBLE:
            break
        credible.add(explanation)
        reached += weight
    return credible

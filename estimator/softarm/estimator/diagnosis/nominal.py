"""What nominal recordings teach: the common coefficients, and how far these carry to other runs."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.evidence import BACKGROUND, RegressionProblem
from softarm.estimator.diagnosis.gaussian import Gaussian, Marginal
from softarm.estimator.diagnosis.normal_equations import NormalEquations, total
from softarm.estimator.diagnosis.weights import Weights

WIDTHS = (0.01, 0.03, 0.06, 0.12, 0.25)
"""Standard deviations tried for what changes of each effect from run to run, in typical sizes."""
WIDEST = 0.5
"""The same where something has changed."""
MATERIAL = 0.1
"""Changes by less, in typical sizes, are as between any two manoeuvres of one arm."""
UNKNOWN = 0.03
"""The same where no nominal recording tells."""
NUISANCE = 0.1
"""What changes of the calibration from run to run, in its prior spread, per typical size of effects."""


def prior_before(evidence: RegressionProblem, weights: Weights) -> tuple[Gaussian, float]:
    """Return the prior with which the recordings in question are judged, and the width it rests on.

    Args:
        evidence: All recordings.
        weights: Noise model.
    """
    parts = [part for part in evidence.products(weights) if part.nominal]
    if not parts:
        return evidence.prior(UNKNOWN, UNKNOWN), UNKNOWN
    prior = evidence.sound()
    width = _width(evidence, prior, parts, weights.effective_sample_fraction)
    learnt = prior.posterior(total(parts, evidence.size), weights.effective_sample_fraction)
    return learnt.inflate(_spreads(evidence, width)), width


def prior_with_background(
    evidence: RegressionProblem,
    parts: Sequence[NormalEquations],
    fraction: float,
    width: float,
    size: float,
    count: int = 1,
) -> Gaussian:
    """Return the prior with more coefficients: what nominal recordings have of an effect or a law.

    The library's columns stand for effects at a few shapes; an arm that is well may have a little of one at
    another shape, or of a law that no effect stands for, and what it has always had is no change.

    Args:
        evidence: All recordings, nominal ones among them.
        parts: Normal equations of the nominal recordings; the last columns are what the library's do not
            stand for.
        fraction: Effective sample fraction: independent samples over samples.
        width: What changes from one nominal run to another, in typical sizes.
        size: Amplitude of a coefficient of 1 in typical sizes.
        count: Number of the last columns.
    """
    prior = evidence.sound().augment(0.0, (BACKGROUND / size) ** 2, count)
    learnt = prior.posterior(total(parts, evidence.size + count), fraction)
    return learnt.inflate(np.append(_spreads(evidence, width), np.full(count, width / size)))


def _spreads(evidence: RegressionProblem, width: float) -> Floats:
    changed = width * evidence.typical
    changed[: evidence.nuisances] *= NUISANCE
    return changed


def _width(
    evidence: RegressionProblem, prior: Gaussian, parts: Sequence[NormalEquations], fraction: float
) -> float:
    """Choose the width at which every nominal recording is best predicted from the others."""
    sessions = sorted({part.session for part in parts})
    if len(sessions) == 1:
        blocks = sorted({part.block for part in parts})
        halves = [blocks[: len(blocks) // 2], blocks[len(blocks) // 2 :]]
        folds = [[part for part in parts if part.block in half] for half in halves]
    else:
        folds = [[part for part in parts if part.session == number] for number in sessions]
    scores = []
    for width in WIDTHS:
        score = 0.0
        for fold in folds:
            rest = [part for part in parts if part not in fold]
            run_prior = prior.posterior(total(rest, evidence.size), fraction).inflate(
                _spreads(evidence, width)
            )
            score += predictive(run_prior, fold, fraction, evidence.size)
        scores.append(score)
    return WIDTHS[int(np.argmax(scores))]


def predictive(prior: Gaussian, fold: Sequence[NormalEquations], fraction: float, size: int) -> float:
    """Return twice the logarithm of the density of a fold under a prior, up to a constant."""
    seen = total(fold, size)
    marginal = Marginal.of(prior, seen, fraction)
    root = np.sqrt(np.diag(prior.covariance))
    inner = np.eye(size) + fraction * _sandwich(prior.covariance, seen.matrix, root)
    return -marginal.cost - float(np.linalg.slogdet(inner)[1])


def evidence_of_change(
    evidence: RegressionProblem,
    prior: Gaussian,
    width: float,
    parts: Sequence[NormalEquations],
    fraction: float,
) -> float:
    """Give how much likelier recordings are if more than a little has changed since the nominal ones.

    No single effect need explain them: all may have changed.

    Args:
        evidence: All recordings.
        prior: Before those in question, which allows for ``width``.
        width: What changes from one nominal run to another, in typical sizes.
        parts: Normal equations of those in question.
        fraction: Effective sample fraction: independent samples over samples.

    Returns:
        Twice the log ratio of the densities, at the likeliest widths above and below ``MATERIAL``.
    """
    little, more = (
        [predictive(one, parts, fraction, evidence.size) for one in priors]
        for priors in _wider(evidence, prior, width)
    )
    return max(more) - max(little)


def changed_prior(
    evidence: RegressionProblem,
    prior: Gaussian,
    width: float,
    parts: Sequence[NormalEquations],
    fraction: float,
) -> Gaussian:
    """Return the likeliest prior of recordings in which more than a little has changed; see above."""
    _, more = _wider(evidence, prior, width)
    return max(more, key=lambda one: predictive(one, parts, fraction, evidence.size))


def _wider(
    evidence: RegressionProblem, prior: Gaussian, width: float
) -> tuple[list[Gaussian], list[Gaussian]]:
    """Return a prior at the widths that are tried: its own and those below ``MATERIAL``, and the others."""
    little: list[Gaussian] = []
    more: list[Gaussian] = []
    for larger in (width, *(w for w in (*WIDTHS, WIDEST) if w > width)):
        wider = prior.inflate(_spreads(evidence, float(np.sqrt(larger**2 - width**2))))
        (little if larger == width or larger < MATERIAL else more).append(wider)
    return little, more


def _sandwich(covariance: Floats, matrix: Floats, root: Floats) -> Floats:
    """Give P G in coordinates scaled by the prior's deviations, for a well-scaled determinant."""
    scaled: Floats = (covariance / np.outer(root, root)) @ (matrix * np.outer(root, root))
    return scaled


__all__ = ["UNKNOWN", "changed_prior", "evidence_of_change", "prior_before", "prior_with_background"]

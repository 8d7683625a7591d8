"""What nominal recordings teach: the common coefficients, and how far these carry to other runs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.evidence import BACKGROUND, RegressionProblem
from softarm.estimator.diagnosis.gaussian import NOTHING, Gaussian
from softarm.estimator.diagnosis.judge import CERTAIN
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.marginal import Marginal, Marginaliser, cost_of
from softarm.estimator.diagnosis.normal_equations import NewColumns, NormalEquations, Total, total
from softarm.estimator.diagnosis.screen import usual_gains
from softarm.estimator.diagnosis.weights import Weights
from softarm.estimator.specimen.physics import EffectName

WIDTHS = (0.01, 0.03, 0.06, 0.12, 0.25)
"""Standard deviations tried for what changes of each effect from run to run, in typical sizes."""
WIDEST = 0.5
"""The same where something has changed."""
MATERIAL = 0.1
"""Changes by less, in typical sizes, are as between any two manoeuvres of one arm."""
UNKNOWN = 0.03
"""What changes from run to run, in typical sizes, where no nominal recording shows it."""
LEAST = 2.0
"""Deviations by which an arm may seem to have less than none of what only dissipates."""
NUISANCE = 0.1
"""What changes of the calibration from run to run, in its prior spread, per typical size of effects."""


def prior_before(
    evidence: RegressionProblem, weights: Weights, suspected: frozenset[EffectName]
) -> tuple[Gaussian, float]:
    """Return the prior with which the recordings in question are judged, and the width it rests on.

    Without nominal recordings nobody knows what the arm has of itself: it may be as much as any arm has, but
    of effects that are looked for.

    Args:
        evidence: All recordings.
        weights: Noise model.
        suspected: Effects that are looked for without nominal recordings; see ``suspects``.
    """
    parts = [part for part in evidence.products(weights) if part.nominal]
    prior = evidence.sound()
    if not parts:
        looked_for = np.array([name in suspected for name in evidence.effects])
        narrow = np.append(np.ones(evidence.nuisances), np.where(looked_for, UNKNOWN / BACKGROUND, 1.0))
        return Gaussian(prior.mean, prior.covariance * np.outer(narrow, narrow)), UNKNOWN
    width = _width(evidence, prior, parts, weights.effective_sample_fraction)
    learnt = prior.posterior(total(parts, evidence.size), weights.effective_sample_fraction)
    return learnt.inflate(_spreads(evidence, width)), width


def suspects(evidence: RegressionProblem, weights: Weights) -> frozenset[EffectName]:
    """Return the effects that recordings without nominal ones show for certain, wherever they act."""
    if evidence.has_nominal:
        return frozenset()
    searched = total([part for part in evidence.products(weights) if not part.heldout], evidence.size)
    seen = Marginaliser.of(searched, evidence.sound(), weights.effective_sample_fraction)
    gains = usual_gains(evidence, Marginal.of(seen))
    return frozenset(name for name, gain in gains.items() if gain > CERTAIN)


def passive(evidence: RegressionProblem, prior: Gaussian) -> RegressionProblem:
    """Bound what dissipates: it may become less than nominal recordings show, but not less than none.

    Args:
        evidence: All recordings.
        prior: Of the common coefficients, from nominal recordings where there are some.
    """

    def bounded(hypothesis: Hypothesis) -> Hypothesis:
        parameters = tuple(
            replace(p, lower=max(p.lower, -_most(evidence, prior, hypothesis, number))) if p.dissipates else p
            for number, p in enumerate(hypothesis.effect.parameters)
        )
        return replace(hypothesis, effect=replace(hypothesis.effect, parameters=parameters))

    hypotheses = tuple(bounded(one) for one in evidence.library.hypotheses)
    return replace(evidence, library=replace(evidence.library, hypotheses=hypotheses))


def _most(evidence: RegressionProblem, prior: Gaussian, hypothesis: Hypothesis, parameter: int) -> float:
    """Return how much of an amplitude, over all its shapes, every segment that an effect acts on may have."""
    most = np.inf
    for segment in evidence.stages[0].world.segments:
        if hypothesis.place.segment not in (None, segment):
            continue
        amount = np.zeros(evidence.size)
        for column, direction in enumerate(evidence.library.directions, evidence.nuisances):
            other = evidence.library.hypotheses[direction.hypothesis]
            here = other.place.segment in (None, segment)
            if other.name == hypothesis.name and here and direction.parameter == parameter:
                amount[column] = direction.typical
        deviation = float(np.sqrt(amount @ prior.covariance @ amount))
        most = min(most, max(float(amount @ prior.mean), 0.0) + LEAST * deviation)
    return most


def background_of(usual: Marginaliser, new: NewColumns, width: float, size: float) -> tuple[Floats, Gaussian]:
    """Return what nominal recordings have of an effect or a law.

    The library's columns stand for effects at a few shapes; an arm that is well may have a little of one at
    another shape, or of a law that no effect stands for, and what it has always had is no change.

    Args:
        usual: The nominal recordings, with the prior of an arm that is well.
        new: Products of the effect's or law's columns in them.
        width: What changes from one nominal run to another, in typical sizes.
        size: Amplitude of a coefficient of 1 in typical sizes.

    Returns:
        By how much the common coefficients are less the more there is of each column, shape (columns, new);
        and the prior of how much there is, then of what changes of it from run to run.
    """
    count = len(new.vector)
    prior = NOTHING.augment(0.0, (BACKGROUND / size) ** 2, count)
    learnt = prior.posterior(usual.marginal(new), 1.0)
    less = usual.factor.solve(usual.fraction * new.cross)
    return less, learnt.augment(0.0, (width / size) ** 2, count)


def usual_recordings(evidence: RegressionProblem, weights: Weights) -> Marginaliser:
    """Return the nominal recordings, with the prior of an arm that is well."""
    seen = total([part for part in evidence.products(weights) if part.nominal], evidence.size)
    return Marginaliser.of(seen, evidence.sound(), weights.effective_sample_fraction)


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
    scores = np.zeros(len(WIDTHS))
    for fold in folds:
        rest = [part for part in parts if part not in fold]
        learnt = prior.posterior(total(rest, evidence.size), fraction)
        seen = total(fold, evidence.size)
        scores += [predictive(learnt.inflate(_spreads(evidence, width)), seen, fraction) for width in WIDTHS]
    return WIDTHS[int(np.argmax(scores))]


def predictive(prior: Gaussian, seen: Total, fraction: float) -> float:
    """Return twice the logarithm of the density of what was seen under a prior, up to a constant."""
    root = np.sqrt(np.diag(prior.covariance))
    inner = np.eye(len(root)) + fraction * _sandwich(prior.covariance, seen.matrix, root)
    return -cost_of(prior, seen, fraction) - float(np.linalg.slogdet(inner)[1])


def evidence_of_change(
    evidence: RegressionProblem,
    prior: Gaussian,
    width: float,
    parts: Sequence[NormalEquations],
    fraction: float,
) -> float:
    """Return how much likelier recordings are if more than a little has changed since the nominal ones.

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
    seen = total(parts, evidence.size)
    little, more = (
        [predictive(one, seen, fraction) for one in priors] for priors in _wider(evidence, prior, width)
    )
    return max(more) - max(little)


def changed_prior(
    evidence: RegressionProblem, prior: Gaussian, width: float, seen: Total, fraction: float
) -> Gaussian:
    """Return the likeliest prior of what was seen if more than a little has changed; see above."""
    _, more = _wider(evidence, prior, width)
    return max(more, key=lambda one: predictive(one, seen, fraction))


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
    """Return P G in coordinates scaled by the prior's deviations, for a well-scaled determinant."""
    scaled: Floats = (covariance / np.outer(root, root)) @ (matrix * np.outer(root, root))
    return scaled


__all__ = [
    "UNKNOWN",
    "background_of",
    "changed_prior",
    "evidence_of_change",
    "passive",
    "prior_before",
    "usual_recordings",
]

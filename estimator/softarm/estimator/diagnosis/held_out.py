"""What a model predicts of the stretches for the report, which have decided nothing."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.gaussian import Factor
from softarm.estimator.diagnosis.innovations import (
    Residuals,
    channel_errors,
    innovation_test,
    learnt_coefficients,
    residuals_out_of_fold,
)
from softarm.estimator.diagnosis.judge import bootstrap
from softarm.estimator.diagnosis.result import (
    Heldout,
)
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.stage import Stage


@dataclass(frozen=True)
class Predictions:
    """Costs of held-out stretches without and with findings.

    Args:
        before: Weighted squares of each stretch without them.
        after: With them.
        counts: Residuals of each.
    """

    before: Floats
    after: Floats
    counts: Floats

    def rms(self) -> tuple[float, float]:
        """Return the normalised root mean squares before and after."""
        total_count = max(float(self.counts.sum()), 1.0)
        return (
            float(np.sqrt(max(self.before.sum(), 0.0) / total_count)),
            float(np.sqrt(max(self.after.sum(), 0.0) / total_count)),
        )


def held_out(search: Search, before: Fit | None, after: Fit | None, *, known: bool = False) -> Predictions:
    """Predict reported stretches without and with effects: those that have decided nothing.

    Common coefficients are those of the model with the effects, learnt outside these stretches. Squares are
    over the noise of quiet stretches; where the arm vibrates after fast changes they count less.

    Args:
        search: The search.
        before: Effects without those that are judged.
        after: Effects with them.
        known: Whether the model without effects is the one that was known before any of the recordings in
            question was seen.
    """
    learnt = learnt_coefficients(search, after)
    common = search.prior.mean if known else learnt
    first, counts = _squares(search, before, common)
    last, _ = _squares(search, after, learnt)
    return Predictions(first, last, counts)


def error_over_expected(search: Search, fit: Fit | None) -> float:
    """Return the rms of what is left of the confirming data, over what the model expects of its own errors.

    Errors e = r - C m have the covariance S = N + C P C^T, N of the noise of quiet stretches, P of the common
    coefficients that the searched stretches leave open: what few samples predict is uncertain, and to err so
    far is no sign that something is missing. By Woodbury's identity e^T S^-1 e = e^T N^-1 e - v^T (P^-1 + C^T
    N^-1 C)^-1 v, with v = C^T N^-1 e.
    """
    left = search.left(fit)
    learnt = left.folds.whole
    known = learnt.fraction * learnt.data.matrix + learnt.prior.precision
    cross, squares, count = np.zeros(len(learnt.mean)), 0.0, 0
    for number, residual in enumerate(left.residuals):
        stage, columns = search.evidence.stages[number], search.evidence.columns[number]
        unseen = (stage.session.heldout & ~stage.session.reported)[:, None] & np.isfinite(residual)
        if stage.session.nominal or not unseen.any():
            continue
        scale = _over_noise(search, stage)[unseen]
        change = columns[unseen] * scale[:, None]
        error = residual[unseen] * scale - change @ learnt.mean
        known, cross = known + change.T @ change, cross + change.T @ error
        squares, count = squares + float(error @ error), count + len(error)
    return float(np.sqrt(max(squares - float(cross @ Factor.of(known).solve(cross)), 0.0) / max(count, 1)))


def _over_noise(search: Search, stage: Stage) -> Floats:
    """Return one over the noise of quiet stretches, less where the model is unsure, shape (samples, rows)."""
    names = channels(stage.suite)
    row = search.weights.stds(names)
    calm: Floats = row / stage.error_std(row) / [search.evidence.floors[name] for name in names]
    return calm


def _squares(search: Search, fit: Fit | None, common: Floats) -> tuple[Floats, Floats]:
    """Return the squares over the noise, and their number, of each reported stretch."""
    squares: list[float] = []
    counts: list[float] = []
    for number, residual in enumerate(search.left(fit).residuals):
        stage = search.evidence.stages[number]
        session = stage.session
        unseen = session.reported
        if session.nominal or not unseen.any():
            continue
        squared = ((residual - search.evidence.columns[number] @ common) * _over_noise(search, stage)) ** 2
        for block in np.unique(session.blocks[unseen]):
            chosen = squared[(session.blocks == block) & unseen]
            squares.append(float(np.nansum(chosen)))
            counts.append(float(np.isfinite(chosen).sum()))
    return np.array(squares), np.array(counts)


def heldout_result(
    search: Search, fit: Fit | None, predictions: Predictions, before: Residuals, after: Residuals, how: str
) -> Heldout:
    """Judge the whole model on held-out data.

    Args:
        search: The search.
        fit: All findings.
        predictions: Costs of held-out stretches without and with them.
        before: Residuals of each session without them, shape (samples, rows).
        after: The same with them.
        how: In words, which data these are.
    """
    rms_before, rms_after = predictions.rms()
    interval = (0.0, 0.0)
    if len(predictions.before) > 1 and not np.array_equal(predictions.before, predictions.after):
        interval = bootstrap(search.rng, predictions.before, predictions.after)
    errors = channel_errors(search, before, after)
    test = innovation_test(search, after, residuals_out_of_fold(search, fit))
    return Heldout(rms_before, rms_after, interval, how, errors, test)

"""The residual of held-out data: its size by channel, whether it is noise, where it is worst."""

from collections.abc import Iterator, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.discrepancy import Autoregression, ljung_box
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.line import line_errors
from softarm.estimator.diagnosis.result import ChannelError, InnovationTest, Stretch
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.stage import Stage

Residuals = Sequence[Floats]


def learnt_coefficients(search: Search, fit: Fit | None) -> Floats:
    """Return the common coefficients that the searched stretches show with some effects, shape (columns,)."""
    return search.left(fit).folds.whole.mean


def residuals_of(search: Search, fit: Fit | None, coefficients: Floats) -> list[Floats]:
    """Compute measured minus predicted with some effects and common coefficients.

    Returns:
        Of each session, shape (samples, rows).
    """
    return [
        residual - columns @ coefficients
        for residual, columns in zip(search.left(fit).residuals, search.evidence.columns, strict=True)
    ]


def residuals_out_of_fold(search: Search, fit: Fit | None) -> list[Floats]:
    """Compute measured minus predicted of searched stretches, with common coefficients that others show.

    A model follows the stretches that it was fitted to, so that what it leaves of them is less than what it
    leaves of others.

    Args:
        search: The search.
        fit: Effects.

    Returns:
        Of each session, shape (samples, rows); of other stretches with the coefficients of all searched ones.
    """
    residuals = residuals_of(search, fit, learnt_coefficients(search, fit))
    left = search.left(fit)
    for numbers, rest in zip(left.folds.numbers, left.folds.rest, strict=True):
        for part in (left.searched[k] for k in numbers):
            stage = search.evidence.stages[part.session]
            chosen = stage.session.blocks == part.block
            columns = search.evidence.columns[part.session][chosen]
            residuals[part.session][chosen] = left.residuals[part.session][chosen] - columns @ rest.mean
    return residuals


def residuals_as_known(search: Search, fit: Fit | None) -> list[Floats]:
    """Compute what the calibrated model leaves of nominal recordings, and with all findings of the others.

    Returns:
        Of each session, shape (samples, rows).
    """
    learnt = learnt_coefficients(search, fit)
    evidence = search.evidence
    return [
        residual - columns @ (search.prior.mean if stage.session.nominal else learnt)
        for stage, residual, columns in zip(
            evidence.stages, search.left(fit).residuals, evidence.columns, strict=True
        )
    ]


def worst_over_nominal(search: Search, fit: Fit | None) -> float:
    """Return the error of the worst stretch in question over that of the worst nominal one.

    Of each stretch it is the largest root mean square of a channel, over what the calibrated model errs by
    there. It takes no notice of how large the mismatch is, with which the weights of the search decline: a
    wall that buckles once is a small part of all recordings, and an error of many degrees. Stretches for the
    report decide nothing. Without nominal recordings it is 0.
    """
    worst = {True: 0.0, False: 0.0}
    for stage, residual in zip(search.evidence.stages, residuals_as_known(search, fit), strict=True):
        session = stage.session
        errors = residual / assumed_std(search, stage)
        for block in np.unique(session.blocks[~session.reported]):
            largest = float(_rms(errors[session.blocks == block]).max())
            worst[session.nominal] = max(worst[session.nominal], largest)
    return worst[False] / worst[True] if worst[True] > 0.0 else 0.0


def before_and_after(search: Search, fit: Fit | None) -> tuple[list[Floats], list[Floats]]:
    """Compute measured minus predicted as the model was known before, and with all findings.

    Without findings both are of the model with the common coefficients that the recordings show.

    Args:
        search: The search.
        fit: All findings.

    Returns:
        Residuals of each session, shape (samples, rows).
    """
    learnt = learnt_coefficients(search, fit)
    after = residuals_of(search, fit, learnt)
    return (after if fit is None else residuals_of(search, None, search.prior.mean)), after


def channel_errors(search: Search, before: Residuals, after: Residuals) -> dict[str, ChannelError]:
    """Compute the error of each channel on held-out data.

    Args:
        search: The search.
        before: Residuals of each session without what is judged, shape (samples, rows).
        after: The same with it.
    """
    squares: dict[str, list[Floats]] = {}
    kinds: dict[str, str] = {}
    for number, stage in _questioned(search):
        reported = stage.session.reported
        both = np.stack([before[number][reported], after[number][reported]])
        for row, (name, unit) in enumerate(zip(channels(stage.suite), stage.suite.units, strict=True)):
            good = np.isfinite(both[..., row]).all(axis=0)
            squares.setdefault(name, []).append(both[:, good, row] ** 2)
            kinds[name] = unit
    errors = {}
    lines = line_errors([stage.session for stage in search.evidence.stages])
    for name, parts in squares.items():
        whole = np.concatenate(parts, axis=1)
        if whole.shape[1]:
            first, last = np.sqrt(whole.mean(axis=1)).tolist()
            errors[name] = ChannelError(kinds[name], first, last, lines.get(name))
    return errors


def innovation_test(search: Search, residuals: Residuals, searched: Residuals) -> InnovationTest:
    """Compare held-out residuals with the noise that was assumed, and with the memory that others show.

    Residuals are over the standard deviation that the choice assumed. Their mean square is about zero, so
    that a constant error counts. Innovations are what the past of a stretch does not predict, by a process
    that the searched stretches show.

    Args:
        search: The search.
        residuals: Of each session with all findings, shape (samples, rows).
        searched: Those of the searched stretches, as far as others predict them; see
            ``residuals_out_of_fold``.
    """
    searched_errors = _standardised(search, searched, reported=False)
    held_out_errors = _standardised(search, residuals, reported=True)
    kept = {
        name: value
        for name in held_out_errors
        if (value := _mean([one**2 for one in held_out_errors[name]])) > 0.0
    }
    variance, correlation, chance = {}, {}, {}
    for name in kept:
        process = Autoregression.fitted(searched_errors.get(name, []))
        innovations = [process.innovations(one) for one in held_out_errors[name]]
        size = _mean([one**2 for one in innovations])
        if np.isfinite(size):
            variance[name] = size
            correlation[name], chance[name] = ljung_box(innovations)
    alike = {name: ljung_box(held_out_errors[name])[0] for name in kept}
    return InnovationTest(variance, correlation, chance, kept, alike)


def _standardised(search: Search, residuals: Residuals, *, reported: bool) -> dict[str, list[Floats]]:
    """List the residuals of each channel by stretch, over the standard deviation that the choice assumed."""
    standardised: dict[str, list[Floats]] = {}
    for number, stage in enumerate(search.evidence.stages):
        session = stage.session
        if session.nominal:
            continue
        scaled = residuals[number] / assumed_std(search, stage)
        chosen = session.reported if reported else ~session.heldout
        for block in np.unique(session.blocks[chosen]):
            stretch = scaled[(session.blocks == block) & chosen]
            for name, column in zip(channels(stage.suite), stretch.T, strict=True):
                standardised.setdefault(name, []).append(column)
    return standardised


def worst_stretch(search: Search, residuals: Residuals) -> Stretch | None:
    """Find the stretch of time and the channel whose error is the largest multiple of what was assumed.

    Args:
        search: The search.
        residuals: Of each session with all findings, shape (samples, rows).
    """
    worst: tuple[float, Stretch] | None = None
    for number, stage in enumerate(search.evidence.stages):
        session = stage.session
        if session.nominal:
            continue
        errors = np.stack([residuals[number], residuals[number] / assumed_std(search, stage)])
        for block in np.unique(session.blocks):
            in_block = session.blocks == block
            rms, standardised = _rms(errors[:, in_block])
            row = int(np.argmax(standardised))
            time = session.time[in_block]
            if worst is None or standardised[row] > worst[0]:
                place = (session.name, channels(stage.suite)[row], stage.suite.units[row])
                times = (float(time[0]), float(time[-1]))
                worst = (float(standardised[row]), Stretch(*place, *times, float(rms[row])))
    return worst[1] if worst else None


def _questioned(search: Search) -> Iterator[tuple[int, Stage]]:
    """List the sessions in question of which something is reported, with their numbers."""
    for number, stage in enumerate(search.evidence.stages):
        if not stage.session.nominal and stage.session.reported.any():
            yield number, stage


def assumed_std(search: Search, stage: Stage) -> Floats:
    """Return the standard deviation that the choice assumed, whatever the residual, shape (samples, rows)."""
    return stage.error_std(search.weights.stds(channels(stage.suite)))


def _rms(errors: Floats) -> Floats:
    """Return the root mean square of what is not lost along the samples, shape (..., samples, rows); or 0."""
    finite = np.isfinite(errors)
    squares = np.where(finite, errors**2, 0.0).sum(axis=-2)
    rms: Floats = np.sqrt(squares / np.maximum(finite.sum(axis=-2), 1))
    return rms


def _mean(parts: Sequence[Floats]) -> float:
    """Average what is not lost; NaN where nothing is."""
    values = np.concatenate(parts) if parts else np.zeros(0)
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")

"""Sensors that stand still while the calibrated model moves."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.diagnosis.result import Evidence, Finding, Quantity
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import LEVER, Stage
from softarm.estimator.effects import EFFECTS
from softarm.estimator.intake.stuck_pressures import ASKED, LEAST, REPEATED, Stuck
from softarm.estimator.series import runs
from softarm.estimator.specimen.physics import Place

LONGER = (1, 2, 4)
"""Multiples of ``LEAST`` over which motion is looked for: slow ones take longer to show."""
MOVING = 0.05
"""Motion that the model must predict meanwhile [rad], and a hundredth of it in metres."""
STILL = 0.02
"""Share of the predicted motion below which a reading stands still."""
LATE = 0.5
"""A sensor that is late by less [s] has not moved yet at the end of a stretch; it does not stand still."""


def stuck_notes(stuck: Sequence[Stuck]) -> list[str]:
    """State what stands in for readings that stand still."""
    return [
        f"{one.recording}: {one.sensor} stands still from {one.since:.1f} to {one.until:.1f} s; "
        + (
            "its set-point stands in for it."
            if one.sensor.startswith("pressure")
            else "it is left out meanwhile."
        )
        for one in stuck
    ]


def without_repeated(session: Session) -> Session:
    """Lose what a sensor reads while it repeats one and the same number and pressures change.

    It may stand still or see nothing move; either way a calibration must not follow it.
    """
    readings = session.readings.copy()
    for measurement in session.suite.measurements:
        entries = session.suite.reading_slices[measurement.name]
        observed = np.flatnonzero(np.isfinite(readings[:, entries]).all(axis=1))
        changes = np.abs(np.diff(readings[observed][:, entries], axis=0)).max(axis=1, initial=0.0)
        for part in np.split(observed, np.flatnonzero(changes > REPEATED) + 1):
            if len(part) < 3 or session.clock[part[-1]] - session.clock[part[0]] < LEAST:
                continue
            if np.ptp(session.pressures[part], axis=0).max(initial=0.0) > ASKED:
                readings[part, entries] = np.nan
    return replace(session, readings=readings)


def find_stuck(stage: Stage) -> tuple[Stuck, ...]:
    """Find sensors of a session that stand still although the model predicts motion.

    What was read during events counts: one that stands still looks like an event to the intake.
    """
    stuck = []
    stage = stage.with_events
    time = stage.session.time
    measured, residual = stage.reading_rows, stage.residual
    predicted = measured - residual
    for measurement in stage.suite.measurements:
        rows = stage.suite.slices[measurement.name]
        size = np.array([LEVER if unit == "m" else 1.0 for unit in measurement.units])
        shown, wanted = measured[:, rows] / size, predicted[:, rows] / size
        for start, end in _still(time, shown, wanted):
            during = slice(start, end)
            stuck.append(
                Stuck(
                    stage.session.name,
                    measurement.name,
                    float(time[start]),
                    float(time[end - 1]),
                    float(np.sqrt(np.nanmean((residual[during, rows] / size) ** 2))),
                    float(np.sqrt(np.nanmean((shown[during] - np.nanmean(shown[during], axis=0)) ** 2))),
                    end - start,
                )
            )
    return tuple(stuck)


def without_stuck(stage: Stage, stuck: tuple[Stuck, ...]) -> Stage:
    """Lose the readings of sensors while they stand still."""
    if not stuck:
        return stage
    session = stage.session
    lost = np.zeros(session.readings.shape, dtype=bool)
    time = session.time
    for one in stuck:
        entries = stage.suite.reading_slices.get(one.sensor)
        if entries is not None:
            lost[(time >= one.since) & (time <= one.until), entries] = True
    events = session.event_readings
    left = replace(
        session,
        readings=np.where(lost, np.nan, session.readings),
        event_readings=None if events is None else np.where(lost, np.nan, events),
    )
    return replace(stage, session=left)


def stuck_findings(stuck: Sequence[Stuck]) -> tuple[Finding, ...]:
    """Report every sensor that stood still, from the first time on."""
    findings = []
    for sensor in dict.fromkeys(one.sensor for one in stuck):
        intervals = [one for one in stuck if one.sensor == sensor]
        count = sum(one.samples for one in intervals)
        before, after = (
            float(np.sqrt(sum(one.samples * getattr(one, name) ** 2 for one in intervals) / count))
            for name in ("before", "after")
        )
        first = min(one.since for one in intervals)
        place = Place(sensor=sensor)
        where = "; ".join(f"{one.recording} from {one.since:.1f} to {one.until:.1f} s" for one in intervals)
        words = EFFECTS["sensor_stuck"].sentence(np.array([1.0, first]), place)
        moving = "its set-point" if sensor.startswith("pressure") else "the arm"
        gain = count * np.log(max(before, 1e-12) / max(after, 1e-6)) - 2.0 * np.log(count)
        share = 1.0 - after / max(before, 1e-12)
        findings.append(
            Finding(
                "sensor_stuck",
                place,
                "time of the run",
                f"{words} It stands still while {moving} moves: {where}.",
                {"share": Quantity(1.0, 0.01, "1"), "since": Quantity(first, 0.1, "s")},
                Evidence(float(gain), before, after, (share, share), float("nan")),
                probability=float(expit(gain)),
            )
        )
    return tuple(findings)


def _still(time: Floats, shown: Floats, wanted: Floats) -> list[tuple[int, int]]:
    """List the longest stretches in which readings stand still and predictions move, or have moved away."""
    step = float(np.median(np.diff(time)))
    late = int(np.ceil(LATE / step))
    flags = np.zeros(len(time), dtype=bool)
    for width in (max(3, round(times * LEAST / step)) for times in LONGER):
        if len(time) <= width:
            break
        motion = _range(wanted, max(2, width - late))[: len(time) - width + 1]
        quiet = _range(shown, width) < STILL * np.maximum(motion, MOVING)
        for k in np.flatnonzero(quiet & (motion > MOVING)):
            flags[k : k + width] = True
    for start, end in runs(flags):
        flags |= _held(shown, wanted, slice(start, end))
    return runs(flags)


def _held(shown: Floats, wanted: Floats, during: slice) -> Flags:
    """Return for how long, around a stretch, a reading stays what it was there and the prediction is away."""
    read = np.isfinite(shown[during]).any(axis=0)
    shown, wanted = shown[:, read], wanted[:, read]
    level = np.nanmedian(shown[during], axis=0)
    moved = (np.nanmax(wanted[during], axis=0) - np.nanmin(wanted[during], axis=0)).max()
    same = np.nan_to_num(np.abs(shown - level)).max(axis=1) < STILL * max(float(moved), MOVING)
    away = np.nan_to_num(np.abs(shown - wanted)).max(axis=1) > MOVING
    flags = same & away
    flags[during] = True
    around = next(run for run in runs(flags) if run[0] <= during.start < run[1])
    held = np.zeros(len(flags), dtype=bool)
    held[slice(*around)] = True
    return held


def _range(values: Floats, width: int) -> Floats:
    """Return the largest range of any component in each window, shape (samples - width + 1,)."""
    values = values[:, np.isfinite(values).any(axis=0)]
    filled = np.where(np.isfinite(values), values, np.nanmedian(values, axis=0))
    windows = np.lib.stride_tricks.sliding_window_view(filled, width, axis=0)
    ranges: Floats = (windows.max(axis=-1) - windows.min(axis=-1)).max(axis=1, initial=0.0)
    return ranges

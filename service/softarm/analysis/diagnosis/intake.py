"""Checks and repairs of recordings before a diagnosis: what they find becomes findings of its own."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from softarm.analysis.offline.inputs import check_and_correct
from softarm.estimator.diagnosis.admit import motion_left, usable
from softarm.estimator.diagnosis.events import EventErrors, errors_of
from softarm.estimator.diagnosis.result import Diagnosis, Evidence, Finding, Quantity
from softarm.estimator.effects.amounts import Amount
from softarm.estimator.errors import InputError
from softarm.estimator.intake import Disturbance, Intake, RecordingFault
from softarm.estimator.intake.result import NO_MISMATCH
from softarm.estimator.intake.stuck import WINDOW
from softarm.estimator.intake.unsteady import LEAST
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import Place

SURE = 1e12
"""Odds at which evidence is cut off: no finding is more certain."""
EDGE = 0.5
"""How well the begin and the end of an event are known [s]."""


def check_recordings(
    suspects: Sequence[Recording],
    nominal: Sequence[Recording],
    specimen: Specimen,
    notify: Callable[[str], None] = lambda _: None,
) -> tuple[tuple[Recording, ...], tuple[Recording, ...], tuple[Intake, ...], tuple[str, ...]]:
    """Check and correct recordings.

    They are of one laboratory: an axis of it that some of them show to be mirrored is so in all, unless more
    of them show otherwise.

    Args:
        suspects: Recordings in question.
        nominal: Recordings of the arm in its known state.
        specimen: The robot.
        notify: Called with what was set aside, left out or assumed, which is no finding.

    Returns:
        Recordings in question and nominal ones as fits may see them, the intakes of those in question,
        and what was found in words.

    Raises:
        InputError: No recording of a kind fits the specimen or can be corrected; single ones are set aside.
    """

    def checked(mirrored: int | None) -> tuple[tuple[Intake, ...], tuple[Intake, ...], list[str], list[str]]:
        notes: list[str] = []
        aside: list[str] = []
        questioned, known = (
            usable(
                group,
                lambda recording: _required(check_and_correct(recording, specimen, notes.append, mirrored)),
                notes,
                aside.append,
            )
            for group in (suspects, nominal)
        )
        return questioned, known, notes, aside

    taken = checked(None)
    own = _mirrored(taken[:2])
    if len(set(own.values()) - {None}) == 1:
        (axis,) = set(own.values()) - {None}
        again = checked(axis)
        otherwise = sum(other != axis for other in _mirrored(again[:2]).values())
        taken = again if otherwise < sum(one == axis for one in own.values()) else taken
    questioned, known, notes, aside = taken
    for words in aside:
        notify(words)
    for one in (fault for intake in (*questioned, *known) for fault in intake.mismatches):
        if one.kind in NO_MISMATCH:
            notify(one.statement)
    return tuple(i.for_fits for i in questioned), tuple(i.for_fits for i in known), questioned, tuple(notes)


def _mirrored(groups: Sequence[Sequence[Intake]]) -> dict[str, int | None]:
    """Return which axis of the laboratory each recording with frames shows to be mirrored, by its name."""
    return {
        intake.recording.name: next((m.mirrored for m in intake.mismatches if m.mirrored is not None), None)
        for intake in chain(*groups)
        if intake.recording.frames
    }


def _required(intake: Intake) -> Intake:
    """Refuse a recording of whose motion no fit may see anything, with what was found in it."""
    if not intake.excluded or motion_left(intake.for_fits):
        return intake
    found = [one.what for one in intake.mismatches]
    found += [
        f"an event from {event.interval[0]:.1f} to {event.interval[1]:.1f} s" for event in intake.events
    ]
    raise InputError(
        intake.recording.name,
        f"no reading of the motion is left that a fit may see: {'; '.join(found)}",
        "record the motion together with its pressures, below their limits, with the sensors in view",
    )


def with_touches(
    intakes: Sequence[Intake], nominal: Sequence[Recording], touches: Sequence[Disturbance]
) -> tuple[tuple[Intake, ...], tuple[Disturbance, ...]]:
    """Add what a diagnosed model found to the events of the intake.

    Args:
        intakes: Of the recordings in question.
        nominal: Nominal recordings.
        touches: Events of all of them, by the clock of the diagnosis, which goes on between recordings.

    Returns:
        The intakes with their events, and the events of nominal recordings, all by the recordings' own time.
    """
    starts = {one.name: one.start for one in (*nominal, *(intake.recording for intake in intakes))}
    own: dict[str, list[Disturbance]] = {}
    for touch in touches:
        begin, end = (moment - starts[touch.recording] for moment in touch.interval)
        own.setdefault(touch.recording, []).append(replace(touch, interval=(begin, end)))
    added = tuple(
        replace(
            intake,
            events=_joined([*intake.events, *events]),
            excluded=(*intake.excluded, *(event.interval for event in events)),
        )
        for intake in intakes
        for events in [own.pop(intake.recording.name, [])]
    )
    return added, tuple(touch for events in own.values() for touch in events)


def _joined(events: Sequence[Disturbance]) -> tuple[Disturbance, ...]:
    """Merge events that overlap: the model sees more of what the intake saw in part."""
    found: list[Disturbance] = []
    for event in sorted(events, key=lambda one: one.interval):
        if found and event.interval[0] < found[-1].interval[1]:
            event = found.pop().joined(event)
        found.append(event)
    return tuple(found)


def with_intakes(
    diagnosis: Diagnosis,
    intakes: Sequence[Intake],
    notes: Sequence[str],
    on_the_model: Sequence[EventErrors] = (),
) -> Diagnosis:
    """Add findings of the intake; their data were corrected or left out, so the verdict is that of the rest.

    The intake compares a recording with a steady law that the recording itself shows. An event that the model
    with all findings predicts is none: it becomes a note. So does every event where nominal recordings show
    that the arm now follows a law without a name, for the effect of such a law is unknown.

    Args:
        diagnosis: What was found of the recordings as fits may see them.
        intakes: Of the recordings in question.
        notes: What was noticed of the recordings.
        on_the_model: What the model with all findings leaves of their events.
    """
    events: list[Disturbance] = []
    for intake in intakes:
        for event in intake.events:
            cause = _cause(diagnosis, intake, event, on_the_model)
            if cause:
                notes = (*notes, f"{event.statement} {cause}")
            else:
                events.append(event)
    faults = [one for intake in intakes for one in intake.mismatches if one.kind not in NO_MISMATCH]
    # A sensor that stands still in several recordings is one finding.
    alike: dict[object, list[RecordingFault]] = {}
    for number, one in enumerate(faults):
        alike.setdefault(one.columns if one.kind == "stuck" else number, []).append(one)
    found = list(diagnosis.findings)
    mismatches: list[Finding] = []
    for mismatch in (mismatch_finding(*group) for group in alike.values()):
        same = next((k for k, one in enumerate(found) if _one_stuck_sensor(mismatch, one)), None)
        if same is None:
            mismatches.append(mismatch)
        else:
            found[same] = _both_stuck(mismatch, found[same])
    findings = (*mismatches, *found, *map(event_finding, events))
    return replace(diagnosis, findings=findings, notes=(*notes, *diagnosis.notes))


def _one_stuck_sensor(mismatch: Finding, other: Finding) -> bool:
    """Return whether the intake and the model report the same sensor as stuck."""
    return mismatch.effect == other.effect == "sensor_stuck" and mismatch.where == other.where


def _both_stuck(mismatch: Finding, other: Finding) -> Finding:
    """Merge into one finding what the intake saw in some recordings and the model in others."""
    since = min(mismatch.parameters["since"], other.parameters["since"], key=lambda one: one.value)
    statement = f"{other.statement} {mismatch.statement}"
    return replace(
        other, statement=statement, parameters={**other.parameters, "since": since}, recording=None
    )


def _cause(
    diagnosis: Diagnosis, intake: Intake, event: Disturbance, on_the_model: Sequence[EventErrors]
) -> str:
    """Write what explains an event after all; empty where nothing does."""
    if diagnosis.nominal and diagnosis.verdict == "unexplained":
        return "An unknown effect may have caused it."
    errors = errors_of(event.recording, on_the_model)
    begin, end = (moment + intake.recording.start for moment in event.interval)
    residuals = errors.explained((begin, end)) if errors else None
    if residuals is None:
        return ""
    if not residuals:
        return "The model knows no stable equilibrium there: the arm may have snapped through by itself."
    within = " and ".join(f"{Amount(size, unit)}" for unit, size in residuals.items())
    beyond = any(size > LEAST[unit] for unit, size in residuals.items())
    usual = ", no more than it and its findings may get wrong there" if beyond else ""
    return f"The model with all findings predicts it to within {within}{usual}, so it is no event."


def event_finding(event: Disturbance) -> Finding:
    """Report a stretch of time that no steady law explains."""
    begin, end = event.interval
    size, usual = (event.size_rad, event.usual_rad) if event.size_rad else (event.size_m, event.usual_m)
    parameters = {"begin": Quantity(begin, EDGE, "s"), "end": Quantity(end, EDGE, "s")}
    if event.size_rad:
        parameters["angle"] = Quantity(event.size_rad, event.usual_rad, "rad")
    if event.size_m:
        parameters["displacement"] = Quantity(event.size_m, event.usual_m, "m")
    chamber = None
    if event.equivalent is not None:
        chamber, pressure = event.equivalent
        share = usual / max(size, 1e-9)
        parameters["equivalent_pressure"] = Quantity(pressure, abs(pressure) * share, "Pa")
    odds = min(event.probability / max(1.0 - event.probability, 1.0 / SURE), SURE)
    ratio = size / max(usual, 1e-9)
    return Finding(
        "event",
        Place(chamber=chamber, sensor=event.channels[0] if len(event.channels) == 1 else None),
        "time of the run",
        event.statement,
        parameters,
        Evidence(float(np.log(odds)), ratio, 1.0, (1.0 - 1.0 / max(ratio, 1.0),) * 2, float("nan")),
        probability=event.probability,
        interval=event.interval,
        recording=event.recording,
    )


def mismatch_finding(mismatch: RecordingFault, *more: RecordingFault) -> Finding:
    """Report a sensor that stands still, or a frame, label, unit or clock that was corrected.

    Args:
        mismatch: The fault.
        more: The same fault in other recordings.
    """
    every = (mismatch, *more)
    one = mismatch.columns[0] if len(mismatch.columns) == 1 else None
    odds = min(max(fault.odds for fault in every), SURE)
    stuck = mismatch.kind == "stuck" and mismatch.interval is not None
    sensor, _, axis = (one or "").partition(".")
    begins = [fault.interval[0] for fault in every if fault.interval]
    return Finding(
        "sensor_stuck" if stuck else "frame_mismatch",
        Place(sensor=sensor or None, axis=axis or None),
        "time of the run" if stuck else "always",
        " ".join(fault.statement for fault in every),
        {"since": Quantity(min(begins), WINDOW, "s")} if begins else {},
        Evidence(float(np.log(odds)), 0.0, 0.0, (0.0, 0.0), float("nan")),
        probability=1.0 - 1.0 / (1.0 + odds),
        recording=None if more else mismatch.recording,
    )

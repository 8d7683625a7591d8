"""The verdict on recordings of valves: what is found, and what the law of a valve leaves."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.significance import scatter_limit
from softarm.estimator.diagnosis.admit import PRESSURES_MOVE, Admitted, motion_columns
from softarm.estimator.diagnosis.result import (
    Baseline,
    Diagnosis,
    Evidence,
    Finding,
    Heldout,
    LocationMap,
    Trace,
    Unexplained,
    Verdict,
)
from softarm.estimator.diagnosis.valve_stage import BY_CHANCE, Split, channel_error, gain_interval, of_chamber
from softarm.estimator.diagnosis.valves import LEAST_SAMPLES, SETTLED
from softarm.estimator.errors import InputError
from softarm.estimator.specimen.physics import Place

LEFT_OVER = 5.0
"""Root mean square over the noise from which something beyond the law is left, such as overshoot."""
NEEDED = (
    f"more than {LEAST_SAMPLES} readings of a set-point and its pressure together are needed up to the "
    "middle of the time in which the valve is open, and some after it"
)
"""What it takes to learn a valve's law and to judge it."""


def wrong_sensors(of_arm: Sequence[Finding], of_valves: Sequence[Finding]) -> tuple[str, ...]:
    """Note pressure sensors that read a wrong share: set-points and the arm both contradict them.

    Args:
        of_arm: What the arm does by its measured pressures.
        of_valves: What measured pressures do by their set-points.
    """
    arm, valves = (
        {one.where.chamber: one.parameters["gain"] for one in group if one.effect == "chamber_gain"}
        for group in (of_arm, of_valves)
    )
    notes = []
    for chamber in sorted(k for k in arm.keys() & valves.keys() if k is not None):
        more, read = arm[chamber], valves[chamber]
        product = (1.0 + more.value) * (1.0 + read.value)
        std = np.hypot((1.0 + read.value) * more.std, (1.0 + more.value) * read.std)
        if abs(product - 1.0) <= 2.0 * std:
            notes.append(
                f"Chamber {chamber}: its pressure reads {1.0 + read.value:.2f} times its set-point, and the "
                f"arm moves as by {1.0 + more.value:.2f} times the reading. Both are one fault if the sensor "
                "is wrong and the valve is not."
            )
    return tuple(notes)


def not_compared(suspects: Sequence[Split], nominal: Sequence[Split]) -> tuple[str, ...]:
    """Note which valves the nominal recordings leave out while they hold others."""
    known = {split.valve.chamber for split in nominal}
    others = sorted({split.valve.chamber for split in suspects} - known)
    if not known or not others:
        return ()
    return (
        f"The nominal recordings hold other valves only: what the valves of {_chambers(others)} do "
        "is not compared with anything.",
    )


def _chambers(numbers: Sequence[int]) -> str:
    """Write chambers as words."""
    return f"chamber{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def not_judged(admitted: Admitted, splits: Sequence[Split]) -> tuple[str, ...]:
    """Name the recordings of valves alone by which no valve can be judged."""
    judged = {split.recording for split in splits}
    return tuple(
        f"{recording.name}: no valve can be judged; {NEEDED}."
        for recording, _ in admitted.all
        if not motion_columns(recording) and recording.name not in judged
    )


def left_over(suspects: Sequence[Split], nominal: Sequence[Split]) -> dict[int, float]:
    """Find the valves whose law leaves more than noise, and more than in nominal recordings.

    The law has no overshoot and no ripple, so every valve leaves something. Mean squares are compared by an F
    test in which each settling time is one independent sample. Set-points that change more may leave more in
    proportion.

    Args:
        suspects: Valves in question.
        nominal: Valves in their known state; empty where there are no such recordings.

    Returns:
        The mean square that is left on unseen samples [Pa^2], by chamber.
    """
    chambers = sorted({split.valve.chamber for split in suspects})
    left = {}
    for chamber in chambers:
        splits, references = of_chamber(suspects, chamber), of_chamber(nominal, chamber)
        if nominal and not references:
            continue
        ours, allowed = _mean_square(splits), (LEFT_OVER * max(split.floor for split in splits)) ** 2
        if references:
            ours_freedom, usual_freedom = (_unseen(group) / SETTLED for group in (splits, references))
            ratio = scatter_limit(ours_freedom, usual_freedom, BY_CHANCE / len(chambers))
            allowed = max(allowed, ratio**2 * _usual(splits, references))
        if ours > allowed:
            left[chamber] = ours
    return left


def over_nominal(suspects: Sequence[Split], nominal: Sequence[Split]) -> float | None:
    """Return what laws leave as a multiple of the same in nominal recordings; ``None`` without these."""
    ours, theirs = 0.0, 0.0
    for chamber in {split.valve.chamber for split in nominal} & {split.valve.chamber for split in suspects}:
        splits = of_chamber(suspects, chamber)
        ours += _mean_square(splits)
        theirs += _usual(splits, of_chamber(nominal, chamber))
    return float(np.sqrt(ours / theirs)) if theirs else None


def _usual(splits: Sequence[Split], references: Sequence[Split]) -> float:
    """Return the mean square that nominal recordings leave, or would with these set-points [Pa^2]."""
    active, usual = (float(np.mean([split.activity**2 for split in group])) for group in (splits, references))
    return _mean_square(references) * max(1.0, active / max(usual, 1e-9))


def _squares(split: Split) -> Floats:
    """Return the squares of what a law leaves of unseen samples [Pa^2], shape (unseen,)."""
    errors = split.measured - split.predicted
    return errors[split.heldout] ** 2


def _mean_square(splits: Sequence[Split]) -> float:
    """Return the mean square of what laws leave of unseen samples, over recordings [Pa^2]."""
    return float(np.mean([np.mean(_squares(split)) for split in splits]))


def _unseen(splits: Sequence[Split]) -> float:
    """Return the time that laws have not seen [s]."""
    return sum(split.unseen_seconds for split in splits)


def _unknown(chamber: int, splits: Sequence[Split], heldout: Heldout) -> Finding:
    """Report that a valve does something that no law of valves describes."""
    own = of_chamber(splits, chamber)
    setpoint, law = np.sqrt(np.mean([np.square(split.errors()) for split in own], axis=0)).tolist()
    words = (
        f"The pressure in chamber {chamber} does what no delay, offset, dead band or ceiling of its valve "
        f"describes: with all of these the error on unseen data is {1e-3 * law:.2f} kPa, and "
        f"{1e-3 * setpoint:.2f} kPa without."
    )
    return Finding(
        effect="unknown",
        where=Place(chamber=chamber),
        when="pressure level" if _at_rest(own) else "time since a change",
        statement=words,
        parameters={},
        evidence=Evidence(0.0, heldout.before, heldout.after, (0.0, 0.0), float("nan")),
        probability=None,
    )


def _at_rest(splits: Sequence[Split]) -> bool:
    """Return whether most of what laws leave is left while set-points rest."""
    squares, resting = 0.0, 0.0
    for split in splits:
        changed = np.abs(np.diff(split.setpoint, prepend=split.setpoint[0])) > 1.0
        since = split.time - np.maximum.accumulate(np.where(changed, split.time, split.time[0] - SETTLED))
        left = _squares(split)
        squares += float(left.sum())
        resting += float(left[since[split.heldout] >= SETTLED].sum())
    return resting > 0.5 * squares


def valve_diagnosis(
    specimen: str,
    admitted: Admitted,
    splits: Sequence[Split],
    faults: tuple[Finding, ...],
    nominal: Sequence[Split] = (),
) -> Diagnosis:
    """Write down a diagnosis of recordings that hold valves alone.

    Args:
        specimen: Name of the specimen.
        admitted: The recordings.
        splits: The valves of those in question.
        faults: What valves and their sensors were found to do.
        nominal: The valves of nominal recordings.

    Raises:
        InputError: No valve's law could be learnt and judged, or nominal recordings hold other valves only.
    """
    names = ", ".join(recording.name for recording in admitted.suspects)
    if not splits:
        seen = " ".join(fault.statement for fault in faults)
        raise InputError(
            names,
            f"no valve can be judged: {NEEDED}{seen and f' ({seen})'}",
            f"record {PRESSURES_MOVE}",
        )
    known = {split.valve.chamber for split in nominal}
    if nominal and not faults and not known & {split.valve.chamber for split in splits}:
        valves = _chambers(sorted({split.valve.chamber for split in splits}))
        raise InputError(
            names,
            f"the nominal recordings hold the valves of {_chambers(sorted(known))}, these those of {valves}",
            "record these valves in their known state too, or compare them with their set-points, without "
            "--nominal",
        )
    rms: dict[str, list[float]] = {}
    noise: dict[str, list[float]] = {}
    for split in splits:
        channel = f"pressure_{split.valve.chamber}"
        rms.setdefault(channel, []).append(split.valve.rms)
        noise.setdefault(channel, []).append(split.floor)
    errors = np.array([split.errors() for split in splits])
    floors = np.array([split.floor for split in splits])
    before, after = (float(np.sqrt(np.mean((column / floors) ** 2))) for column in errors.T)
    heldout = Heldout(
        before,
        after,
        gain_interval(splits),
        "each valve's law is learnt from the first half of its activity and judged on the second",
        {
            name: channel_error(errors[[f"pressure_{split.valve.chamber}" == name for split in splits]])
            for name in rms
        },
    )
    left = left_over(splits, nominal)
    verdicts: dict[tuple[bool, bool], Verdict] = {
        (False, False): "consistent",
        (False, True): "unexplained",
        (True, False): "explained",
        (True, True): "partly_explained",
    }
    worst = max(left, key=left.__getitem__, default=None)
    unknown = () if worst is None or faults else (_unknown(worst, splits, heldout),)
    return Diagnosis(
        specimen=specimen,
        recordings=tuple(recording.name for recording in admitted.suspects),
        nominal=tuple(recording.name for recording in admitted.nominal),
        verdict=verdicts[bool(faults), bool(left)],
        baseline=Baseline(
            {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in rms.items()},
            {name: float(np.mean(values)) for name, values in noise.items()},
            dict.fromkeys(rms, "Pa"),
            before,
        ),
        map=LocationMap(),
        findings=(*faults, *unknown),
        heldout=heldout,
        unexplained=Unexplained(after, over_nominal=over_nominal(splits, nominal)),
        notes=(*admitted.notes, "The recordings hold valves alone, no motion of the arm."),
        traces=tuple(
            Trace(
                split.recording,
                f"pressure_{split.valve.chamber}",
                "Pa",
                split.time,
                split.measured,
                split.setpoint,
                split.predicted,
                split.heldout,
            )
            for split in splits
        ),
    )

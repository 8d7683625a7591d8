"""Which recordings can carry a diagnosis, and what is wrong with the others in one line."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.counted import counted
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import SHIPPED, Specimen

Given = TypeVar("Given")
Taken = TypeVar("Taken")

PRESSURES_MOVE = "at least 20 s in which pressures rise above 10 kPa and come down again"
ARM_MOVES = "at least 20 s in which the arm moves and comes to rest"
"""What a diagnosis needs, with chambers and without."""
LEAST_SAMPLES = 20
LEAST_SECONDS = 0.5
LONGEST_GAP = 1.0
"""A gap [s] above it is reported."""
ABOUT = 30
"""Samples before and after a gap that show how fast readings change."""
ONWARD = 4.0
"""A reading that changes over a gap by less than so many of its largest changes nearby goes on through it."""
STILL = {"m": 2e-4, "rad": 2e-3}
"""Spread of a reading [m, rad] below which a channel does not move."""


@dataclass(frozen=True)
class Admitted:
    """Recordings that can carry a diagnosis.

    Args:
        suspects: Recordings in question.
        nominal: Recordings of the arm in its known state.
        notes: What was noticed.
    """

    suspects: tuple[Recording, ...]
    nominal: tuple[Recording, ...]
    notes: tuple[str, ...]

    @property
    def all(self) -> list[tuple[Recording, bool]]:
        """Every recording and whether it is nominal, nominal ones first."""
        return [(r, True) for r in self.nominal] + [(r, False) for r in self.suspects]

    def only(self, names: Collection[str]) -> "Admitted":
        """Keep the recordings of some names."""
        suspects, nominal = (
            tuple(one for one in group if one.name in names) for group in (self.suspects, self.nominal)
        )
        return Admitted(suspects, nominal, self.notes)

    def mended(self, mend: Callable[[Recording], Recording], notes: Sequence[str]) -> "Admitted":
        """Mend every recording, and note why."""
        suspects, nominal = (tuple(map(mend, group)) for group in (self.suspects, self.nominal))
        return Admitted(suspects, nominal, (*self.notes, *notes))


def usable(
    group: Sequence[Given],
    take: Callable[[Given], Taken],
    notes: list[str],
    notify: Callable[[str], None] = lambda _: None,
) -> tuple[Taken, ...]:
    """Take recordings one by one; one that is refused is set aside and noted where others are left.

    Args:
        group: What to take.
        take: Takes one, or refuses it.
        notes: Get a sentence for each that is set aside.
        notify: Called with the same sentence.

    Raises:
        InputError: All of them are refused.
    """
    taken: list[Taken] = []
    refusals: list[InputError] = []
    for one in group:
        try:
            taken.append(take(one))
        except InputError as error:
            refusals.append(error)
    if refusals and not taken:
        raise refusals[0]
    for refusal in refusals:
        notes.append(f"{refusal.where}: {refusal.what}; set aside, {refusal.cure}.")
        notify(notes[-1])
    return tuple(taken)


def admit(
    suspects: Sequence[Recording],
    nominal: Sequence[Recording],
    specimen: Specimen,
    notify: Callable[[str], None] = lambda _: None,
) -> Admitted:
    """Check recordings, and set aside those that can decide nothing.

    Args:
        suspects: Recordings in question.
        nominal: Recordings of the arm in its known state.
        specimen: The robot.
        notify: Called with what is set aside, and why.

    Raises:
        InputError: None in question, or no nominal one, is left: they are of another specimen, too short,
            too still to decide anything, or without pressures.
    """
    notes: list[str] = []
    whole = any(len(recording.chambers) == len(specimen.chambers) for recording in (*nominal, *suspects))

    def checked(recording: Recording) -> Recording:
        _check_specimen(recording, specimen)
        _check_pressures(recording, specimen, whole=whole)
        _check_length(recording, specimen)
        _check_motion(recording)
        return recording

    nominal, suspects = (usable(group, checked, notes, notify) for group in (nominal, suspects))
    for recording in (*nominal, *suspects):
        notes += _time_notes(recording)
    if not any(moves(recording) or _opens_valves(recording) for recording in suspects):
        names = ", ".join(recording.name for recording in suspects)
        raise _nothing_moves(names, suspects, specimen)
    return Admitted(suspects, nominal, tuple(notes))


def motion_columns(recording: Recording) -> dict[str, Floats]:
    """Return the columns that describe the arm's motion."""
    kinds = ("frame_", "bend_", "marker_")
    return {name: values for name, values in recording.columns.items() if name.startswith(kinds)}


def moves(recording: Recording) -> bool:
    """Return whether any reading moves by more than noise."""
    for name, values in motion_columns(recording).items():
        observed = values[np.isfinite(values)]
        if len(observed) < 2:
            continue
        low, high = np.percentile(observed, [2.0, 98.0])
        if high - low > (STILL["m"] if name.endswith("_m") else STILL["rad"]):
            return True
    return False


def motion_left(recording: Recording) -> bool:
    """Return whether any reading of the motion is left, where there was one."""
    motion = motion_columns(recording).values()
    return not motion or any(np.isfinite(values).any() for values in motion)


def _nothing_moves(names: str, suspects: Sequence[Recording], specimen: Specimen) -> InputError:
    """Refuse recordings that can decide nothing, with the columns that they lack for a test of valves."""
    columns = {name for one in suspects for name in one.columns}
    asked = any(name.startswith("pressure_cmd_") for name in columns)
    measured = any(name.startswith("pressure_") and "cmd" not in name for name in columns)
    if any(motion_columns(one) for one in suspects) or asked == measured:
        return InputError(names, "nothing moves, so nothing can be decided", _to_record(specimen))
    held, lacking = ("set-points", "pressure_0_pa") if asked else ("measured pressures", "pressure_cmd_0_pa")
    what = f"holds {held} alone, so nothing can be decided"
    cure = f"record {lacking} and its like as well to compare valves, or the motion of the arm to diagnose it"
    return InputError(names, what, cure)


def _to_record(specimen: Specimen) -> str:
    """State what a diagnosis needs."""
    return f"record {PRESSURES_MOVE if specimen.chambers else ARM_MOVES}"


def _opens_valves(recording: Recording) -> bool:
    """Return whether set-points and pressures were recorded without the arm: a test of valves."""
    both = [
        np.nanmax(recording.columns[f"pressure_cmd_{k}_pa"], initial=0.0) > 1000.0
        for k in recording.chambers
        if {f"pressure_cmd_{k}_pa", f"pressure_{k}_pa"} <= set(recording.columns)
    ]
    return not motion_columns(recording) and any(both)


def _check_specimen(recording: Recording, specimen: Specimen) -> None:
    named = recording.info.get("specimen")
    if not isinstance(named, str) or named == specimen.name or named.endswith(".toml"):
        return
    sections = {section.name for section in specimen.sections}
    strange = {*recording.frames, *recording.bends} - sections
    more = any(chamber >= len(specimen.chambers) for chamber in recording.chambers)
    if {named, specimen.name} <= {*SHIPPED} or strange or more:
        raise InputError(
            f"{recording.name}, specimen",
            f"it was recorded on {named!r}, not on {specimen.name!r}",
            f"give --specimen {named}",
        )


def _check_pressures(recording: Recording, specimen: Specimen, *, whole: bool) -> None:
    """Refuse a recording of motion that lacks pressures, all or those that others hold."""
    missing = [k for k in range(len(specimen.chambers)) if k not in recording.chambers]
    if specimen.chambers and not recording.chambers:
        raise InputError(
            recording.name,
            "holds no pressures, so nothing can be predicted",
            "record pressure_0_pa and its like along with the motion",
        )
    if whole and missing and motion_columns(recording):
        listed = ", ".join(map(str, missing))
        raise InputError(
            recording.name,
            f"lacks the pressures of chambers {listed}, which other recordings hold",
            "write zeros where a chamber stayed vented",
        )


def _check_length(recording: Recording, specimen: Specimen) -> None:
    count = len(recording.time)
    seconds = float(recording.time[-1] - recording.time[0]) if count > 1 else 0.0
    if count < LEAST_SAMPLES or seconds < LEAST_SECONDS:
        verb = "is" if count == 1 else "are"
        raise InputError(
            recording.name,
            f"{counted(count, 'sample')} in {seconds:.2g} s {verb} too short to decide anything",
            _to_record(specimen),
        )


def _check_motion(recording: Recording) -> None:
    if not motion_left(recording):
        raise InputError(
            recording.name,
            "no reading of the motion is left: all are lost, or in stretches that no fit may see",
            "record longer, below the limits of the pressures, with the sensors in view",
        )


def _time_notes(recording: Recording) -> list[str]:
    """Report gaps, jumps of the clock, and sensors that lost many of their readings."""
    broken = _breaks(recording.time)
    notes = [_break_note(recording)] if broken else []
    notes += [
        f"{recording.name}: pressure_{chamber} was never read; its set-point stands in for it."
        for chamber in recording.chambers
        if f"pressure_{chamber}_pa" in recording.columns and recording.pressure(chamber)[1] == "commanded"
    ]
    gaps: list[str] = []
    sensors: dict[str, dict[str, NDArray[np.bool_]]] = {}
    for name, values in motion_columns(recording).items():
        sensor, axis = name.removesuffix("_m").removesuffix("_rad").rsplit("_", 1)
        sensors.setdefault(sensor, {})[axis] = np.isfinite(values)
    for sensor, axes in sensors.items():
        shares = {axis: _lost(recording.time, observed) for axis, observed in axes.items()}
        least = min(shares.values())
        if least > 0.2:
            notes.append(f"{recording.name}: {least:.0%} of the readings of {sensor} are lost.")
        notes += [
            f"{recording.name}: {lost:.0%} of the readings of {sensor}, axis {axis}, are lost."
            for axis, lost in shares.items()
            if lost > max(0.2, least + 0.01)
        ]
        observed = np.logical_or.reduce(list(axes.values()))
        if least <= 0.2 and not broken and not gaps and _breaks(recording.time[observed]):
            longest = float(np.diff(recording.time[observed]).max())
            gaps.append(f"{recording.name}: {sensor} has a gap of {longest:.2f} s.")
    return [*notes, *gaps]


def _breaks(time: Floats) -> bool:
    steps = np.diff(time)
    return len(steps) > 0 and float(steps.max()) > max(LONGEST_GAP, 20.0 * float(np.median(steps)))


def _lost(time: Floats, observed: NDArray[np.bool_]) -> float:
    """Return the share of a sensor's own readings that are missing; streams may be of different rates."""
    if observed.sum() < 3:
        return 1.0
    expected = float(time[-1] - time[0]) / float(np.median(np.diff(time[observed]))) + 1.0
    return 1.0 - float(observed.sum()) / expected


def _break_note(recording: Recording) -> str:
    """Report the longest break: where everything goes on through it, the clock may have jumped."""
    steps = np.diff(recording.time)
    place = int(np.argmax(steps))
    where = f"{steps[place]:.2f} s at {recording.time[place]:.1f} s"
    pressures = (recording.pressure(k)[0] for k in recording.chambers)
    channels = [*motion_columns(recording).values(), *pressures]
    if all(_goes_on(values, place) for values in channels):
        return f"{recording.name}: the clock jumps by {where}, or nothing changed meanwhile."
    return f"{recording.name}: a gap of {where}."


def _goes_on(values: Floats, place: int) -> bool:
    before, after = values[max(0, place - ABOUT) : place + 1], values[place + 1 : place + 1 + ABOUT]
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    if not len(before) or not len(after):
        return True
    nearby = np.concatenate([np.abs(np.diff(before)), np.abs(np.diff(after)), [1e-12]])
    return bool(abs(after[0] - before[-1]) <= ONWARD * nearby.max())

"""Which recordings can carry a diagnosis, and what is wrong with the others in one line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.errors import InputError
from estimator.recording import Floats, Recording
from estimator.specimen import Specimen

LEAST_SAMPLES = 20
LEAST_SECONDS = 0.5
LONGEST_GAP = 1.0
"""A gap [s] above it is told."""
BACKWARD = 3.0
"""A step of the clock larger than so many seconds is told as a jump of the clock."""
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


def admit(suspects: Sequence[Recording], nominal: Sequence[Recording], specimen: Specimen) -> Admitted:
    """Check recordings.

    Raises:
        InputError: One is of another specimen, too short, or too still to decide anything.
    """
    notes: list[str] = []
    for recording in (*nominal, *suspects):
        _check_specimen(recording, specimen)
        _check_length(recording)
        notes += _time_notes(recording)
    if not any(moves(recording) or _opens_valves(recording) for recording in suspects):
        names = ", ".join(recording.name for recording in suspects)
        raise InputError(
            names,
            "nothing moves, so nothing can be decided",
            "record at least 20 s in which pressures rise above 10 kPa and come down again",
        )
    return Admitted(tuple(suspects), tuple(nominal), tuple(notes))


def motion_columns(recording: Recording) -> dict[str, Floats]:
    """Give the columns that tell of the arm's motion."""
    kinds = ("frame_", "bend_", "marker_")
    return {name: values for name, values in recording.columns.items() if name.startswith(kinds)}


def moves(recording: Recording) -> bool:
    """Tell whether any reading moves by more than noise."""
    for name, values in motion_columns(recording).items():
        seen = values[np.isfinite(values)]
        if len(seen) < 2:
            continue
        low, high = np.percentile(seen, [2.0, 98.0])
        if high - low > (STILL["m"] if name.endswith("_m") else STILL["rad"]):
            return True
    return False


def _opens_valves(recording: Recording) -> bool:
    """Tell whether set-points and pressures were recorded without the arm: a test of valves."""
    both = [
        np.nanmax(recording.columns[f"pressure_cmd_{k}_pa"], initial=0.0) > 1000.0
        for k in recording.chambers
        if {f"pressure_cmd_{k}_pa", f"pressure_{k}_pa"} <= set(recording.columns)
    ]
    return not motion_columns(recording) and any(both)


def _check_specimen(recording: Recording, specimen: Specimen) -> None:
    named = recording.info.get("specimen")
    if isinstance(named, str) and named != specimen.name and not named.endswith(".toml"):
        known = {section.name for section in specimen.sections}
        used = {*recording.frames, *recording.bends}
        chambers = len(specimen.chambers)
        if used - known or any(chamber >= chambers for chamber in recording.chambers):
            raise InputError(
                f"{recording.name}, specimen",
                f"it was recorded on {named!r}, not on {specimen.name!r}",
                f"give --specimen {named}",
            )


def _check_length(recording: Recording) -> None:
    count = len(recording.time)
    seconds = float(recording.time[-1] - recording.time[0]) if count > 1 else 0.0
    if count < LEAST_SAMPLES or seconds < LEAST_SECONDS:
        raise InputError(
            recording.name,
            f"{count} samples in {seconds:.2g} s are too short to decide anything",
            "record at least 20 s with changes of pressure",
        )


def _time_notes(recording: Recording) -> list[str]:
    steps = np.diff(recording.time)
    usual = float(np.median(steps))
    found = []
    longest = float(steps.max())
    if longest > max(LONGEST_GAP, 20.0 * usual):
        where = float(recording.time[int(np.argmax(steps))])
        kind = "the clock jumps" if longest > BACKWARD else "a gap"
        found.append(f"{recording.name}: {kind} by {longest:.2f} s at {where:.1f} s.")
    for name, values in motion_columns(recording).items():
        lost = float(np.mean(~np.isfinite(values)))
        if lost > 0.2 and name.endswith(("_x_m", "_x_rad")):
            found.append(f"{recording.name}: {lost:.0%} of {name} is lost.")
    return found

"""Which parts of the recordings no fit and no choice may see."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.calibration.acceptance import LEAST_PRESSURE_SPREAD
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.excitation import inventory, mount_turned

SHARE = 0.15
"""Share of the recordings in question that are held out whole."""
LEAST = 4
"""Recordings from which whole ones are held out."""


def hold_out(sessions: Sequence[Session], limits: np.ndarray) -> tuple[tuple[Session, ...], str]:
    """Cut the recordings in question into three parts: to fit on, to confirm a choice on, and to report.

    Of four or more, whole recordings are held out whose excitation the others have as well: the one in which
    most chambers are driven is reported, else the last of them. The others, and every fifth stretch of time
    of what remains, confirm. Of fewer recordings, every fourth stretch is held out; these confirm and are
    reported in turn, and a single one is reported.

    Args:
        sessions: All sessions, nominal ones among them.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).

    Returns:
        The sessions and how they were split, in words.
    """
    suspects = [k for k, session in enumerate(sessions) if not session.nominal]
    if len(suspects) >= LEAST:
        chosen = _spare(sessions, suspects, limits)
        if chosen:
            last = max(chosen, key=lambda k: (_driven(sessions[k]), k))
            marked = tuple(
                s if s.nominal else _by_recording(s, whole=k in chosen, reported=k == last)
                for k, s in enumerate(sessions)
            )
            return marked, (
                f"the whole recording {sessions[last].name}, which decided nothing; what confirmed the "
                "choice lies in the others"
            )
    marked = _by_stretches(sessions)
    if not any((session.heldout & ~session.reported).any() for session in marked):
        return marked, "the one stretch of time that could be spared, which decided nothing; none confirmed"
    return marked, (
        "every eighth stretch of time, which decided nothing, from one and the same kind of run; what "
        "confirmed the choice lies between them"
    )


def excitation(sessions: Sequence[Session], limits: np.ndarray) -> frozenset[str]:
    """List what some recordings excite together."""
    excitations: set[str] = set()
    for session in sessions:
        if session.pressures.shape[1]:
            excitations |= inventory(session.clock, session.pressures, session.gravity, limits)
    if mount_turned(np.concatenate([session.gravity for session in sessions])):
        excitations.add("mount_turned")
    clock = np.concatenate([session.clock for session in sessions])
    if float(np.ptp(clock)) >= 600.0:
        excitations.add("long_run")
    return frozenset(excitations)


def _spare(sessions: Sequence[Session], suspects: Sequence[int], limits: np.ndarray) -> list[int]:
    """Choose recordings, spread over time, whose loss leaves every excitation to the others."""
    wanted = round(SHARE * len(suspects))
    needed = {need for effect in EFFECTS.values() for need in effect.needs}
    whole = excitation([sessions[k] for k in suspects], limits) & needed
    chosen: list[int] = []
    for k in sorted(suspects, key=lambda k: (suspects.index(k) % 4 != 1, suspects.index(k))):
        rest = [sessions[j] for j in suspects if j not in (*chosen, k)]
        if len(chosen) < wanted and whole <= excitation(rest, limits):
            chosen.append(k)
    return sorted(chosen)


def _driven(session: Session) -> int:
    """Count the chambers whose pressures change: what acts on another one shows nothing there."""
    return int((np.ptp(session.pressures, axis=0) > LEAST_PRESSURE_SPREAD).sum())


def _by_recording(session: Session, *, whole: bool, reported: bool) -> Session:
    """Hold a whole recording out, or every fifth stretch of it."""
    out = np.ones(session.samples, dtype=bool) if whole else session.blocks % 5 == 3
    return replace(session, heldout=out, confirms=out & (not reported))


def _by_stretches(sessions: Sequence[Session]) -> tuple[Session, ...]:
    """Hold every fourth stretch out, beginning with the third; every second of these is reported."""
    stretches = [
        (k, block)
        for k, s in enumerate(sessions)
        if not s.nominal
        for block in np.unique(s.blocks[s.blocks % 4 == 2]).tolist()
    ]
    confirming = set(stretches[::2]) if len(stretches) > 1 else set()
    marked = []
    for k, session in enumerate(sessions):
        out = (session.blocks % 4 == 2) & (not session.nominal)
        blocks = [block for number, block in confirming if number == k]
        marked.append(replace(session, heldout=out, confirms=out & np.isin(session.blocks, blocks)))
    return tuple(marked)

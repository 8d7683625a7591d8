"""Which parts of the recordings no fit and no choice may see."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.diagnosis.session import Session
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.excitation import inventory, mount_turned

SHARE = 0.15
"""Share of the recordings in question that are held out whole."""
LEAST = 4
"""Recordings from which whole ones are held out."""


def hold_out(sessions: Sequence[Session], limits: np.ndarray) -> tuple[tuple[Session, ...], str]:
    """Mark what is held out.

    Of four or more recordings in question, whole ones are held out whose excitation the others have as well,
    and of the others every fifth stretch of time; of fewer recordings, every fourth stretch.

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
            names = ", ".join(sessions[k].name for k in chosen)
            marked = tuple(
                s
                if s.nominal
                else replace(s, heldout=np.ones(s.samples, dtype=bool) if k in chosen else s.blocks % 5 == 3)
                for k, s in enumerate(sessions)
            )
            return marked, f"whole recordings held out ({names}), and every fifth stretch of the others"
    marked = tuple(s if s.nominal else _stretches(s) for s in sessions)
    return marked, "every fourth stretch of time held out, from one and the same kind of run"


def excitation(sessions: Sequence[Session], limits: np.ndarray) -> frozenset[str]:
    """List what some recordings excite together."""
    found: set[str] = set()
    for session in sessions:
        if session.pressures.shape[1]:
            found |= inventory(session.clock, session.pressures, session.gravity, limits)
    if mount_turned(np.concatenate([session.gravity for session in sessions])):
        found.add("mount_turned")
    clock = np.concatenate([session.clock for session in sessions])
    if float(np.ptp(clock)) >= 600.0:
        found.add("long_run")
    return frozenset(found)


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


def _stretches(session: Session) -> Session:
    """Hold every fourth stretch out, beginning with the third."""
    out = session.blocks % 4 == 2
    return replace(session, heldout=out)

"""A linear regression of the readings on the pressures: what any model of the arm has to better."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.session import Session, channels

ANGLES_OR_PLACES = (2, 3)
"""Sizes of readings that a line can predict: bends and markers; orientations are no vectors."""


def line_errors(sessions: Sequence[Session]) -> dict[str, float]:
    """Fit y = A p + b to what is not held out, and compute its error on what is reported.

    Args:
        sessions: All sessions; those in question are reported.

    Returns:
        Root mean square of each channel of bends and markers, in its unit; none for an arm without chambers.
    """
    if not any(session.pressures.shape[1] for session in sessions):
        return {}
    names = {name for session in sessions for name in channels(session.suite)}
    errors = {name: _line_error(sessions, name) for name in sorted(names)}
    return {name: error for name, error in errors.items() if error is not None}


def _line_error(sessions: Sequence[Session], name: str) -> float | None:
    nominal, questioned = [], []
    for session in sessions:
        values = _readings(session, name)
        if values is None:
            continue
        rows = np.column_stack([session.pressures, np.ones(session.samples), values])
        observed = np.isfinite(rows).all(axis=1)
        nominal.append(rows[observed & ~session.heldout])
        if not session.nominal:
            questioned.append(rows[observed & session.reported])
    if not questioned or not len(np.concatenate(questioned)) or not len(np.concatenate(nominal)):
        return None
    learnt, reported = np.concatenate(nominal), np.concatenate(questioned)
    scale = np.maximum(np.abs(learnt[:, :-1]).max(axis=0), 1e-12)
    line, *_ = np.linalg.lstsq(learnt[:, :-1] / scale, learnt[:, -1], rcond=1e-9)
    residual = reported[:, -1] - reported[:, :-1] / scale @ line
    return float(np.sqrt(np.mean(residual**2)))


def _readings(session: Session, name: str) -> Floats | None:
    """Return the readings of a channel, shape (samples,); ``None`` where the session has none of it."""
    sensor, _, letter = name.partition(".")
    part = session.suite.reading_slices.get(sensor)
    if part is None or part.stop - part.start not in ANGLES_OR_PLACES:
        return None
    return np.asarray(session.readings[:, part.start + "xyz".index(letter)])

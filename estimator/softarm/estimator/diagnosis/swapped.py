"""Channels whose names were exchanged, as the model sees them: two chambers, or two sensors of one kind."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.errors import InputError
from softarm.estimator.intake.swapped import refusal

CLEARLY = 0.35
"""Share of the squares that an exchange must leave at most."""
WRONG = 0.1
"""Root mean square of the mismatch [rad] below which nothing is exchanged."""
SIZES = {"m": 0.1, "rad": 1.0}


def refuse_swapped(stages: Sequence[Stage]) -> None:
    """Look for exchanged channels in the recordings in question.

    Raises:
        InputError: Two channels look exchanged.
    """
    suspects = [s for s in stages if not s.session.nominal and not s.session.heldout.all()]
    plain = sum(_squares(stage, stage.residual) for stage in suspects)
    count = sum(int(np.isfinite(stage.residual).sum()) for stage in suspects)
    if count == 0 or np.sqrt(plain / count) < WRONG:
        return
    names = ", ".join(stage.session.name for stage in suspects)
    chambers = suspects[0].drive.pressures.shape[1]
    for a, b in combinations(range(chambers), 2):
        exchanged = sum(_squares(stage, stage.residual - _exchanged(stage, a, b)) for stage in suspects)
        if exchanged < CLEARLY * plain:
            raise _chambers(names, suspects, a, b)
    sensors = suspects[0].suite.measurements
    for one, other in combinations(sensors, 2):
        if one.reading_size != other.reading_size:
            continue
        exchanged = sum(_squares(stage, _misread(stage, one.name, other.name)) for stage in suspects)
        if exchanged < CLEARLY * plain:
            raise refusal(names, f"{one.name} and {other.name}")


def _chambers(names: str, stages: Sequence[Stage], one: int, other: int) -> InputError:
    """Refuse recordings in which two chambers look exchanged, of which one may never be filled."""
    filled = [k for k in (one, other) if any(stage.session.pressures[:, k].any() for stage in stages)]
    if len(filled) > 1:
        return refusal(names, f"the pressures of chambers {one} and {other}")
    given, vented = filled[0], one + other - filled[0]
    what = f"the arm bends as if the pressure of chamber {given} were in chamber {vented}, which is vented"
    return InputError(names, what, f"name its columns after chamber {vented}, or check the tubes")


def _squares(stage: Stage, residual: Floats) -> float:
    size = np.array([SIZES[unit] for unit in stage.suite.units])
    return float(np.nansum((residual / size) ** 2))


def _exchanged(stage: Stage, one: int, other: int) -> Floats:
    """Return by how much the prediction changes when two chambers change places, shape (samples, rows)."""
    pressures = stage.drive.pressures
    change = np.zeros_like(pressures)
    change[:, one] = pressures[:, other] - pressures[:, one]
    change[:, other] = -change[:, one]
    moved: Floats = np.einsum("trc,tc->tr", stage.input_jacobian[..., : pressures.shape[1]], change)
    return moved


def _misread(stage: Stage, one: str, other: str) -> Floats:
    """Return the residual when two sensors change places."""
    readings = stage.session.readings.copy()
    places = stage.suite.reading_slices
    if one not in places or other not in places:
        return stage.residual
    a, b = places[one], places[other]
    readings[:, a], readings[:, b] = stage.session.readings[:, b], stage.session.readings[:, a]
    return stage.innovation(readings)

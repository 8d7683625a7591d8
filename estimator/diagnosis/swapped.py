"""Channels whose names were exchanged: two chambers, or two sensors of one kind."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.session import units
from estimator.diagnosis.stage import Stage
from estimator.errors import InputError

Floats = NDArray[np.float64]

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
        left = sum(_squares(stage, stage.residual - _exchanged(stage, a, b)) for stage in suspects)
        if left < CLEARLY * plain:
            raise _refusal(names, f"pressure_{a}_pa and pressure_{b}_pa")
    sensors = suspects[0].suite.measurements
    for one, other in combinations(sensors, 2):
        if one.reading_size != other.reading_size:
            continue
        left = sum(_squares(stage, _misread(stage, one.name, other.name)) for stage in suspects)
        if left < CLEARLY * plain:
            raise _refusal(names, f"{one.name} and {other.name}")


def _refusal(names: str, pair: str) -> InputError:
    return InputError(names, f"{pair} look exchanged", "exchange their columns, or check the wiring")


def _squares(stage: Stage, left: Floats) -> float:
    size = np.array([SIZES[unit] for unit in units(stage.suite)])
    return float(np.nansum((left / size) ** 2))


def _exchanged(stage: Stage, one: int, other: int) -> Floats:
    """Give by how much the prediction changes when two chambers change places, shape (samples, rows)."""
    pressures = stage.drive.pressures
    change = np.zeros_like(pressures)
    change[:, one] = pressures[:, other] - pressures[:, one]
    change[:, other] = -change[:, one]
    rows = np.nan_to_num(stage.suite.sensitivity(stage.scene, stage.base).twists)
    by_pressure = rows @ stage.arm.baseline.motion[..., : pressures.shape[1]]
    moved: Floats = np.einsum("trc,tc->tr", by_pressure, change)
    return moved


def _misread(stage: Stage, one: str, other: str) -> Floats:
    """Give the residual when two sensors change places."""
    readings = stage.session.readings.copy()
    places, start = {}, 0
    for measurement in stage.suite.measurements:
        places[measurement.name] = slice(start, start + measurement.reading_size)
        start += measurement.reading_size
    if one not in places or other not in places:
        return stage.residual
    a, b = places[one], places[other]
    readings[:, a], readings[:, b] = stage.session.readings[:, b], stage.session.readings[:, a]
    return stage.innovation(readings)

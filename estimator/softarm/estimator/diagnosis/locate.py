"""Where a mismatch sits and what it varies with, before any hypothesis.

At every place stands an equivalent load or offset: bending, twisting and axial couples of a segment, a
pressure in a chamber, an offset of a sensor's channel, a rotation of the base. Each varies with one regime.
A cell's share is what it alone removes of the mismatch beyond noise, the calibration free to move; its
chance is that of so large a gain anywhere in the map where nothing is missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.marginal import null_draws
from softarm.estimator.diagnosis.normal_equations import NewColumns, added
from softarm.estimator.diagnosis.remainder import Remainder
from softarm.estimator.diagnosis.result import Cell, CellKind, LocationMap, Regime
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.simulation import Drive

Label = tuple[CellKind, str, str, str, Regime]
"""Sort of place, which one, axis, unit, and what the load or offset varies with."""

COUPLES = ("x", "y", "z", "axial")
COUPLE_UNITS = ("N m", "N m", "N m", "N")
MEMORY = 3.0
"""Seconds after which a change is forgotten."""
CHANGING, TURNING = 1.5e3, 2e3
"""Rates of a pressure, and of the sum of all, at which something changes, and has a direction [Pa/s]."""
LONG_AGO = 100.0
"""Seconds since the last change before a recording."""
DRAWS = 300
TILT = 1e-3
SIZES = {"N m": 0.01, "N": 0.3, "Pa": 1e3, "m": 1e-3, "rad": 1e-2}
"""What a coefficient of 1 stands for, so that all are of one order."""


@dataclass(frozen=True)
class Spotted:
    """An equivalent load or offset of one place.

    Args:
        kind: Sort of place.
        name: Which one.
        axis: Of the place.
        unit: Of the load.
        column: Change of the predictions per unit, shape (samples, rows).
    """

    kind: CellKind
    name: str
    axis: str
    unit: str
    column: Floats


def locate(left: Remainder, rng: np.random.Generator) -> LocationMap:
    """Map the mismatch of the searched stretches.

    Args:
        left: What accepted effects leave of the recordings in question.
        rng: Of the draws without mismatch.
    """
    found: list[tuple[list[Label], NewColumns]] = []
    for number, stage in enumerate(left.evidence.stages):
        if not stage.session.nominal and not stage.session.heldout.all():
            names, columns = cells_of(stage)
            found.append((names, _products(left, number, columns)))
    if not found:
        return LocationMap()
    # A recording has no cells of the sensors that only others have.
    labels = list(dict.fromkeys(name for names, _ in found for name in names))
    parts = [_placed(own, [labels.index(name) for name in names], len(labels)) for names, own in found]
    shown = left.folds.whole.marginal(added(parts))
    diagonal = np.maximum(np.diag(shown.matrix), 1e-300)
    values = shown.vector / diagonal
    gains = shown.vector * values
    null = (null_draws(shown.matrix, rng, DRAWS) ** 2 / diagonal).max(axis=1)
    explainable = max(shown.sum_of_squares - shown.count, float(gains.max(initial=0.0)), 1e-9)
    cells = [
        Cell(
            kind,
            name,
            axis,
            regime,
            float(abs(value)) * SIZES[unit],
            unit,
            float(gain / explainable),
            float((null >= gain).mean()),
        )
        for (kind, name, axis, unit, regime), value, gain in zip(labels, values, gains, strict=True)
    ]
    return LocationMap(tuple(sorted(cells, key=lambda cell: -cell.share)))


def cells_of(stage: Stage) -> tuple[list[Label], NDArray[np.float32]]:
    """List the cells of a session and their columns, shape (samples, rows, cells)."""
    spots, varied = spotted(stage), regimes(stage)
    names = [(spot.kind, spot.name, spot.axis, spot.unit, regime) for spot in spots for regime in varied]
    columns = np.stack(
        [SIZES[spot.unit] * spot.column * values[:, None] for spot in spots for values in varied.values()],
        axis=-1,
    )
    return names, columns.astype(np.float32)


def _products(left: Remainder, number: int, columns: NDArray[np.float32]) -> NewColumns:
    """Multiply the cells of a session, in single precision: there are hundreds."""
    evidence, residual = left.evidence, left.residuals[number]
    observed = np.isfinite(residual) & ~evidence.stages[number].session.heldout[:, None]
    inverse = np.where(observed, 1.0 / evidence.scale(left.weights, number), 0.0).astype(np.float32)
    cells = (columns * inverse[..., None]).reshape(-1, columns.shape[-1])
    common = (evidence.columns[number] * inverse[..., None]).reshape(len(cells), -1)
    residuals = np.where(observed, np.nan_to_num(residual), 0.0) * inverse
    return NewColumns(
        np.asarray(np.dot(common.T, cells), dtype=np.float64),
        np.asarray(np.dot(cells.T, cells), dtype=np.float64),
        np.asarray(np.dot(cells.T, residuals.ravel()), dtype=np.float64),
    )


def _placed(own: NewColumns, places: Sequence[int], count: int) -> NewColumns:
    """Put the products of some cells at their places among all."""
    cross, matrix, vector = np.zeros((len(own.cross), count)), np.zeros((count, count)), np.zeros(count)
    cross[:, places], matrix[np.ix_(places, places)], vector[places] = own.cross, own.matrix, own.vector
    return NewColumns(cross, matrix, vector)


def spotted(stage: Stage) -> list[Spotted]:
    """List the equivalent loads and offsets of all places."""
    chambers = stage.drive.pressures.shape[1]
    by_pressure, couple_jacobian = stage.input_jacobian[..., :chambers], stage.couple_jacobian
    cells = []
    for g, segment in enumerate(stage.arm.segments.names):
        cells += [
            Spotted("segment", segment, letter, unit, couple_jacobian[..., 4 * g + axis])
            for axis, (letter, unit) in enumerate(zip(COUPLES, COUPLE_UNITS, strict=True))
        ]
    cells += [
        Spotted("chamber", str(chamber), "pressure", "Pa", by_pressure[..., chamber])
        for chamber in range(chambers)
    ]
    for row, (channel, unit) in enumerate(zip(channels(stage.suite), stage.suite.units, strict=True)):
        sensor, _, letter = channel.rpartition(".")
        column = np.zeros(stage.residual.shape)
        column[:, row] = 1.0
        cells.append(Spotted("sensor", sensor, letter, unit, column))
    for axis, letter in enumerate("xy"):
        rotation = np.zeros((stage.session.samples, 3))
        rotation[:, axis] = TILT
        twists = stage.arm.twists(_tilted(stage, rotation)) / TILT
        cells.append(
            Spotted("base", "base", letter, "rad", np.einsum("tri,ti->tr", stage.twist_jacobian, twists))
        )
    return cells


def regimes(stage: Stage) -> dict[Regime, Floats]:
    """Return what a mismatch may vary with, each scaled to unit root mean square, shape (samples,)."""
    time = stage.session.clock
    pressures = stage.session.pressures
    level = pressures.max(axis=1, initial=0.0)
    speed = np.gradient(pressures, time, axis=0) if pressures.size else np.zeros_like(pressures)
    fastest = np.abs(speed).max(axis=1, initial=0.0)
    towards = speed.sum(axis=1) if speed.size else np.zeros(len(time))
    bends = np.linalg.norm(stage.arm.baseline.strains[..., :2], axis=-1)
    pose = bends[:, -1]
    return {
        "constant": np.ones(len(time)),
        "pressure level": _unit(level),
        "direction of change": _unit(np.tanh(towards / TURNING)),
        "time since a change": _unit(1.0 - _since(time, fastest)),
        "rate": _unit(towards),
        "pose": _unit(pose**2),
        "largest strain so far": _unit(np.maximum.accumulate(pose)),
        "time of the run": _unit(time - time[0]),
    }


def _since(time: Floats, fastest: Floats) -> Floats:
    """Return what is left of the memory of the last change, exp(-time since / MEMORY)."""
    moving = fastest > CHANGING
    last = np.maximum.accumulate(np.where(moving, time, time[0] - LONG_AGO))
    decay: Floats = np.exp(-(time - last) / MEMORY)
    return decay


def _unit(values: Floats) -> Floats:
    size = float(np.sqrt(np.mean(values**2)))
    return values / size if size > 0.0 else values


def _tilted(stage: Stage, rotation: Floats) -> Drive:
    return replace(stage.drive, base_rotation=stage.drive.base_rotation + rotation)

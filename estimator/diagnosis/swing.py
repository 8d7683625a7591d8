"""Inertia and damping of the arm as part of the model, where recordings are fast enough to show them.

An arm that hangs swings after every step of pressure. That is no missing physics, but a quasi-static model
would put it down to lags and memories; so one mode for the whole arm is fitted before anything is looked for.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.session import units
from estimator.diagnosis.stage import Stage
from estimator.simulation import LinearisedArm
from estimator.simulation.filters import second_order

Floats = NDArray[np.float64]

INERTIA = (0.02, 0.035, 0.05, 0.065, 0.08, 0.1)
DAMPING = (0.004, 0.012, 0.03, 0.08)
"""Inverse angular frequencies [s] and damping times [s] that are tried."""
FINER = (0.85, 1.0, 1.18)
LONGEST_STEP = 0.11
"""Samples that are further apart [s] do not show a swing."""
LEAST_GAIN = 0.05
"""Share of the squares that a swing must explain to be part of the model."""
SIZES = {"m": 1e-3, "rad": 1e-2}


def fit_swing(stages: Sequence[Stage]) -> Floats | None:
    """Find inertia and damping time [s], shape (2,); ``None`` where recordings show no swing."""
    quick = [stage for stage in stages if stage.session.step <= LONGEST_STEP and _driven(stage)]
    if not quick:
        return None
    still = sum(_squares(stage, None) for stage in quick)
    coarse = [np.array([a, d]) for a in INERTIA for d in DAMPING]
    best = min(coarse, key=lambda theta: _total(quick, theta))
    fine = [best * np.array([p, q]) for p in FINER for q in FINER]
    best = min(fine, key=lambda theta: _total(quick, theta))
    return best if _total(quick, best) < (1.0 - LEAST_GAIN) * still else None


def swinging(stage: Stage, theta: Floats) -> Stage:
    """Give a stage whose model swings; the couples that make it do so become part of its drive."""
    drive = stage.drive.plus(np.zeros_like(stage.drive.wrenches), stage.world.couples(_lag(stage, theta)))
    arm = LinearisedArm(stage.arm.segments, drive, stage.arm.respond(drive))
    return replace(stage, arm=arm, drive=drive)


def _lag(stage: Stage, theta: Floats) -> Floats:
    """Give by how much the strains swing about the quasi-static ones, shape (samples, segments, 4)."""
    strains = stage.arm.baseline.strains
    moving, _ = second_order(stage.session.clock, strains, float(theta[0]), float(theta[1]), ())
    return moving - strains


def _driven(stage: Stage) -> bool:
    return bool(np.ptp(stage.session.pressures, axis=0).max(initial=0.0) > 1000.0)


def _total(stages: Sequence[Stage], theta: Floats) -> float:
    return sum(_squares(stage, theta) for stage in stages)


def _squares(stage: Stage, theta: Floats | None) -> float:
    """Give the squares that are left outside the held-out stretches; their slow part does not count."""
    left = stage.residual
    if theta is not None:
        lag = _lag(stage, theta).reshape(stage.session.samples, -1)
        left = left - np.einsum("trk,tk->tr", stage.by_strain, lag)
    left = left / np.array([SIZES[unit] for unit in units(stage.suite)])
    fast = np.diff(left, axis=0)[~stage.session.heldout[1:]]
    return float(np.nansum(fast**2))

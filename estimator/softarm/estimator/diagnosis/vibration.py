"""Inertia and damping of the arm as part of the model, where recordings are fast enough to show them.

An arm that hangs vibrates after every step of pressure. That is no missing physics, but a quasi-static model
would put it down to lags and memories; so the weighed masses vibrate before anything is looked for, with the
damping that the arm in its known state shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.stage import Stage, Vibrations, fading
from softarm.estimator.simulation import LinearisedArm
from softarm.estimator.simulation.inertia import Masses, StrainDynamics, VibratingArm, strain_stiffness

LONGEST_STEP = 0.11
"""Samples that are further apart [s] do not show a vibration."""
START = (0.0, 2.0, 0.002, 0.03)
LOWER = (-1.2, 0.05, 0.0, -0.1)
UPPER = (1.2, 20.0, 0.1, 0.3)
"""Logarithm of the factor on the masses, damping a [1/s] and b [s], delay of the pressures [s]."""
LEAST_GAIN = 0.05
"""Share of the squares that a vibration must explain to be part of the model."""
SIZES = {"m": 1e-3, "rad": 1e-2}
BUSIEST = 4
"""Recordings to which it is fitted, those that vibrate most."""
OTHER_ARM = 2.0
"""Relative error of the vibration of an arm that has changed, over that of the arm to which it was fitted.

Even with the right effect, of the right size: what else changes, such as the damping, nobody knows. Its
median was 1.5 on five arms of the fake and 2.1 on four others; ``softarm bench proof --part swing``
measures it.
"""
UNHELD = 1e-3
"""Largest load [N, N m] of a section that vibrates freely."""
AFTER = 1.0
"""Time [s] for which a section that was held counts as held."""


@dataclass(frozen=True)
class Vibration:
    """How an arm vibrates.

    Args:
        mass: Factor on the weighed masses.
        damping: Share of the masses [1/s] and of the stiffness [s] that damps.
        delay: By how much motion follows the recorded pressures later than it should [s].
        relative_error: Of the vibration that this predicts.
        frequency: Slowest natural frequency at the first sample [Hz].
    """

    mass: float
    damping: tuple[float, float]
    delay: float
    relative_error: float
    frequency: float

    def sentence(self) -> str:
        """Describe it in one plain sentence."""
        return (
            f"The arm vibrates in these recordings; so does the model, at a lowest frequency of "
            f"{self.frequency:.1f} Hz, with {self.mass:.2f} times the weighed masses."
        )


def fit_vibration(stages: Sequence[Stage], masses: Masses) -> tuple[Vibration | None, tuple[str, ...]]:
    """Fit how the arm of some stages vibrates.

    Returns:
        The vibration, ``None`` where recordings show none, and what to note about it.
    """
    driven = [stage for stage in stages if stage.session.step <= LONGEST_STEP and _driven(stage)]
    quick = [stage for stage in driven if _bounded(stage, masses)]
    notes = tuple(
        f"{stage.session.name}: no vibration was fitted, since the model's stiffness is not known along it."
        for stage in driven
        if not any(stage is one for one in quick)
    )
    if not quick:
        return None, notes
    still = [_fast(stage, stage.residual) for stage in quick]
    loudest = np.argsort([-float(residual @ residual) for residual in still])[:BUSIEST]
    quick, still = [quick[k] for k in loudest], [still[k] for k in loudest]
    matrices = [_dynamics(stage, masses) for stage in quick]

    def residuals(theta: Floats) -> Floats:
        return np.concatenate(
            [
                _fast(stage, stage.residual - _observed(stage, _vibrating(stage, dynamics, theta)))
                for stage, dynamics in zip(quick, matrices, strict=True)
            ]
        )

    solution = least_squares(
        residuals, START, bounds=(LOWER, UPPER), diff_step=1e-2, x_scale=(0.2, 1.0, 0.01, 0.02)
    )
    before, after = float(sum(one @ one for one in still)), float(solution.fun @ solution.fun)
    if after >= (1.0 - LEAST_GAIN) * before:
        return None, notes
    logarithm, a, b, delay = solution.x.tolist()
    mass = float(np.exp(logarithm))
    frequency = matrices[0].frequencies()[0] / np.sqrt(mass)
    vibration = Vibration(mass, (a, b), delay, float(np.sqrt(after / before)), float(frequency))
    return vibration, (*notes, vibration.sentence())


def with_vibration(stage: Stage, vibration: Vibration, masses: Masses, *, other: bool = False) -> Stage:
    """Return a stage whose model vibrates; the couples that make it do so become part of its drive.

    Args:
        stage: The stage.
        vibration: How its arm vibrates.
        masses: Masses that vibrate.
        other: Whether the arm may have changed since that was fitted; see ``OTHER_ARM``.
    """
    if stage.session.step > LONGEST_STEP or not _bounded(stage, masses):
        return stage
    theta = np.array([np.log(vibration.mass), *vibration.damping, vibration.delay])
    vibrations = Vibrations(_vibrating(stage, _dynamics(stage, masses), theta), _still(stage), stage.arm)
    couples = vibrations.couples
    drive = stage.drive.plus(np.zeros_like(stage.drive.wrenches), couples.reshape(stage.drive.couples.shape))
    response = stage.arm.respond(drive)
    # Poses that it swings through and that no stable equilibrium holds have no first order.
    *_, stable = strain_stiffness(response, stage.arm.segments)
    arm = LinearisedArm(stage.arm.segments, drive, replace(response, converged=stable))
    relative = vibration.relative_error * (OTHER_ARM if other else 1.0)
    error = relative * _envelope(stage, moved_by(stage, couples))
    error = np.where(_held(stage)[:, None], stage.model_error_std, error)
    return replace(stage, arm=arm, drive=drive, vibrations=vibrations, vibration_error_std=error)


def _bounded(stage: Stage, masses: Masses) -> bool:
    """Check that an arm with the usual masses vibrates by finite amounts along a stage."""
    if not stage.arm.baseline.converged.any():
        return False
    dynamics = _dynamics(stage, masses)
    if not (np.isfinite(dynamics.stiffness).all() and np.isfinite(dynamics.mass).all()):
        return False
    vibrating = _vibrating(stage, dynamics, np.array(START))
    return bool(np.isfinite(vibrating.couples(vibrating.lag(_still(stage)))).all())


def _envelope(stage: Stage, vibrated: Floats) -> Floats:
    """Return how far the arm has vibrated of late, for each row of the predictions, shape (samples, rows)."""
    angles = np.array([unit == "rad" for unit in stage.suite.units])
    swing = np.abs(vibrated)
    size = [swing[:, angles].max(axis=1, initial=0.0), swing[:, ~angles].max(axis=1, initial=0.0)]
    recent = fading(stage.session.clock, np.stack(size, axis=-1))
    envelope: Floats = np.where(angles, recent[:, :1], recent[:, 1:])
    return envelope


def _dynamics(stage: Stage, masses: Masses) -> StrainDynamics:
    elastic = stage.exact.stiffness().ravel()
    return StrainDynamics.of(stage.arm.baseline, stage.arm.segments, masses, elastic)


def _vibrating(stage: Stage, dynamics: StrainDynamics, theta: Floats) -> VibratingArm:
    """Return the arm of a stage that vibrates as ``START`` lists it, but where a load holds it."""
    converged = stage.arm.baseline.converged
    factor = float(np.exp(theta[0]))
    heavy = dynamics.times(factor)
    damping = (float(theta[1]), float(theta[2]))
    return VibratingArm(
        stage.session.clock,
        heavy,
        damping,
        float(theta[3]),
        converged & dynamics.stable,
        converged & ~_held(stage),
    )


def _still(stage: Stage) -> Floats:
    """Return the quasi-static strains, shape (samples, strains)."""
    strains: Floats = stage.arm.baseline.strains.reshape(stage.session.samples, -1)
    return strains


def _held(stage: Stage) -> NDArray[np.bool_]:
    """Return at which samples a known load holds a section, which then does not vibrate freely."""
    clock = stage.session.clock
    taut = np.abs(stage.session.wrenches).max(axis=(1, 2), initial=0.0) > UNHELD
    last = np.maximum.accumulate(np.where(taut, clock, -np.inf))
    held: NDArray[np.bool_] = clock - last < AFTER
    return held


def _observed(stage: Stage, vibrating: VibratingArm) -> Floats:
    """Return what the vibration changes of the predictions, shape (samples, rows)."""
    return moved_by(stage, vibrating.couples(vibrating.lag(_still(stage))))


def moved_by(stage: Stage, couples: Floats) -> Floats:
    """Return what couples on the segments change of the predictions, shape (samples, rows)."""
    change: Floats = np.einsum("trk,tk->tr", stage.couple_jacobian, couples)
    return change


def _driven(stage: Stage) -> bool:
    return bool(
        stage.arm.baseline.converged.any()
        and np.ptp(stage.session.pressures, axis=0).max(initial=0.0) > 1000.0
    )


def _fast(stage: Stage, residual: Floats) -> Floats:
    """Return what changes from sample to sample outside the held-out stretches, in usual sizes."""
    fast: Floats = np.nan_to_num(steps_of(stage, residual)[~stage.session.heldout[1:]]).ravel()
    return fast


def steps_of(stage: Stage, readings: Floats) -> Floats:
    """Return what changes from sample to sample, in usual sizes, shape (samples - 1, rows)."""
    steps: Floats = np.diff(readings / np.array([SIZES[unit] for unit in stage.suite.units]), axis=0)
    return steps

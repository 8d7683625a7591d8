"""How well a manoeuvre separates two rival explanations.

With y_a the readings under effect a and y_b(theta) those under its rival b, the separation is

    D^2 = min over theta, n of |L (y_a - y_b(theta) - N n)|^2 + |n / s|^2,

N the change of the readings that calibration may still explain (stiffness and pressure gain of each segment,
with standard deviations s) and L a whitener for an error with a few independent values in ten seconds. D^2 is
what a run of the manoeuvre adds to the difference in chi-square (T-optimality: Atkinson and Fedorov,
Biometrika 62, 1975); two explanations separate safely from about 25 on.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.effects.simulate import simulate_with
from softarm.estimator.effects.world import World
from softarm.estimator.excitation.manoeuvre import Manoeuvre
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.rotations import exp, log
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.simulation import Drive, LinearisedArm, RespondingArm, Segments

FADING = 3.0  # s, over which errors of readings and model forget
SLOWEST = 0.87  # from sample to sample; readings scatter also at once, so that jumps count no more than so
FLOOR = {"rad": 3.5e-3, "m": 1e-3}  # what repeated runs of one arm differ by, whatever the sensor
CALIBRATION_STD = 0.05  # relative, of a segment's calibrated stiffness and gain
LEG = 15e3  # Pa between two solutions of the model along a path
SAMPLES = 500
SHORTEST, LONGEST = 0.04, 0.25  # s between samples
DIFFERENCE = 0.02
"""Relative step for a derivative."""
SETTLED = 1e-4
"""Relative change of D^2, or of the rival's parameters, that ends a fit."""


@dataclass(frozen=True)
class SeparatedArm:
    """The arm on which rivals are tried.

    Args:
        arm: Its model.
        world: What effects refer to.
        suite: Sensors.
        gravity: In the usual base frame [m/s2], shape (3,).
    """

    arm: RespondingArm
    segments: Segments
    world: World
    suite: SensorSuite
    gravity: Floats

    def trial(self, manoeuvre: Manoeuvre) -> "SeparationTrial":
        """Run a manoeuvre on the model without effects, linearised along its way."""
        step = float(np.clip(manoeuvre.duration / SAMPLES, SHORTEST, LONGEST))
        time = np.arange(0.0, manoeuvre.duration, step)
        drive = self._drive(manoeuvre, time)
        baseline = _between(*self._stations(manoeuvre), time, self.segments)
        return SeparationTrial(self, drive, LinearisedArm(self.segments, drive, baseline))

    def _drive(self, manoeuvre: Manoeuvre, time: Floats) -> Drive:
        """Return the drive of a manoeuvre; a rotated mount rotates gravity the other way."""
        rotation = exp(np.array(manoeuvre.rotation))
        sections = len(self.world.sections)
        gravity = rotation.T @ self.gravity
        drive = Drive.of(time, manoeuvre.at(time), gravity, sections, self.segments.count)
        wrenches = drive.wrenches.copy()
        wrenches[:, -1, :3] = manoeuvre.force_at(time)
        return replace(drive, wrenches=wrenches)

    def _stations(self, manoeuvre: Manoeuvre) -> tuple[Floats, ArmResponse]:
        """Solve the model at the distinct states that a path passes, close enough to interpolate."""
        times = [0.0]
        for begin, end, low, high in zip(
            manoeuvre.times, manoeuvre.times[1:], manoeuvre.pressures, manoeuvre.pressures[1:], strict=False
        ):
            pieces = max(1, int(np.ceil(np.abs(high - low).max(initial=0.0) / LEG)))
            times += (begin + (end - begin) * np.arange(1, pieces + 1) / pieces).tolist()
        clock = np.array(times)
        drive = self._drive(manoeuvre, clock)
        # To a pascal and to 0.1 mN: a path that comes back to a state does not solve it again.
        state = np.round(np.column_stack([drive.pressures, drive.wrenches[:, -1, :3] * 1e4]))
        _, chosen, back = np.unique(state, axis=0, return_index=True, return_inverse=True)
        solved = self.arm.respond(drive.at(chosen))
        return clock, solved.at(back.ravel())


@dataclass(frozen=True)
class SeparationTrial:
    """A manoeuvre on the model, ready to try effects."""

    subject: SeparatedArm
    drive: Drive
    arm: LinearisedArm

    def readings(self, placed: PlacedEffect | None) -> Floats:
        """Return the readings' change by an effect, whitened, shape (samples x rows of the suite,)."""
        subject = self.subject
        effects = () if placed is None else (placed,)
        done = simulate_with(effects, self.arm, subject.world, self.drive, subject.suite)
        parts = [
            sensor.sensitivity(self.arm.baseline.frames, done.readings[sensor.name]).innovation
            for sensor in subject.suite.measurements
        ]
        return self._whiten(np.concatenate(parts, axis=1))

    def _whiten(self, change: Floats) -> Floats:
        """Divide by the noise and remove what fades slowly."""
        step = float(self.drive.time[1] - self.drive.time[0])
        decay = min(float(np.exp(-step / FADING)), SLOWEST)
        # Where SLOWEST bounds the decay, whitening treats samples as more independent than they are: they
        # weigh less.
        share = step / (2.0 * FADING) * (1.0 + decay) / (1.0 - decay)
        scaled = np.sqrt(min(share, 1.0)) * change / self._floors
        fresh = np.vstack([scaled[:1], (scaled[1:] - decay * scaled[:-1]) / np.sqrt(1.0 - decay**2)])
        return fresh.ravel()

    @cached_property
    def _floors(self) -> Floats:
        """Return the error of each row: the sensor's noise and what repeated runs differ by."""
        rest, rows = self.arm.baseline.frames, []
        frames = Frames(rest.positions[0], rest.rotations[0])
        for sensor in self.subject.suite.measurements:
            noise = np.sqrt(np.diag(sensor.covariance(sensor.predict(frames))))
            rows.append(np.hypot(noise, [FLOOR[unit] for unit in sensor.units]))
        return np.concatenate(rows)

    @cached_property
    def nuisances(self) -> Floats:
        """Return the change that calibration may explain, per deviation, shape (rows, unknowns)."""
        columns, base = [], self.arm.baseline
        owners = np.array(self.subject.world.chamber_segment)
        for segment in range(self.subject.segments.count):
            couples = np.zeros_like(self.drive.couples)
            couples[:, segment] = -CALIBRATION_STD * (base.strains * self.subject.world.stiffness)[:, segment]
            columns.append(self._moved(self.drive.plus(np.zeros_like(self.drive.wrenches), couples)))
            if len(owners):
                gain = 1.0 + CALIBRATION_STD * (owners == segment)
                columns.append(self._moved(replace(self.drive, pressures=self.drive.pressures * gain)))
        return np.column_stack(columns)

    def _moved(self, drive: Drive) -> Floats:
        suite = self.subject.suite
        there = suite.predict(self.arm.respond(drive).frames)
        return self._whiten(suite.sensitivity(self.arm.baseline.frames, there).innovation)

    def separation(self, effect: PlacedEffect, rival: PlacedEffect) -> float:
        """Compute D^2 of an effect and its rival.

        The rival's fit begins at its parameters or at its neutral ones, where the residuals are smaller.
        """
        wanted, parameters = self.readings(effect), rival.effect.parameters

        def residuals(theta: Floats) -> Floats:
            return self._unexplained(wanted - self.readings(replace(rival, theta=theta)))

        def slopes(theta: Floats) -> Floats:
            return -self._unexplained(self._tangent(rival, theta))

        bounds = [p.lower for p in parameters], [p.upper for p in parameters]
        starts = [np.clip(theta, *bounds) for theta in (rival.theta.astype(float), rival.effect.neutral)]
        start = min(starts, key=lambda theta: float((residuals(theta) ** 2).sum()))
        scale = [abs(p.typical) or p.spread for p in parameters]
        solution = least_squares(residuals, start, slopes, bounds, x_scale=scale, ftol=SETTLED, xtol=SETTLED)
        return 2.0 * float(solution.cost)

    @cached_property
    def _explained(self) -> Floats:
        """Orthonormal basis of what calibration may explain, its prior's rows below the readings'."""
        nuisances = self.nuisances
        basis: Floats = np.linalg.qr(np.vstack([nuisances, np.eye(nuisances.shape[1])]))[0]
        return basis

    def _unexplained(self, change: Floats) -> Floats:
        """Project changes onto what calibration does not explain, shape (rows + unknowns, ...)."""
        basis = self._explained
        padded = np.concatenate([change, np.zeros((basis.shape[1], *change.shape[1:]))])
        residual: Floats = padded - basis @ (basis.T @ padded)
        return residual

    def _tangent(self, rival: PlacedEffect, theta: Floats) -> Floats:
        """Differentiate the readings by the rival's parameters, shape (rows, parameters)."""
        columns, here = [], self.readings(replace(rival, theta=theta))
        for k, parameter in enumerate(rival.effect.parameters):
            step = DIFFERENCE * max(abs(theta[k]), abs(parameter.typical) or parameter.spread)
            step = -step if theta[k] + step > parameter.upper else step
            moved = theta.copy()
            moved[k] += step
            columns.append((self.readings(replace(rival, theta=moved)) - here) / step)
        return np.column_stack(columns)


def _between(clock: Floats, solved: ArmResponse, time: Floats, segments: Segments) -> ArmResponse:
    """Interpolate the response between the times at which it was solved."""
    after = np.clip(np.searchsorted(clock, time, side="right"), 1, len(clock) - 1)
    before = after - 1
    share = np.clip((time - clock[before]) / np.maximum(clock[after] - clock[before], 1e-12), 0.0, 1.0)
    low, high = solved.at(before), solved.at(after)
    rotation = log(np.swapaxes(low.frames.rotations, -1, -2) @ high.frames.rotations)
    rotations = low.frames.rotations @ exp(share[:, None, None] * rotation)
    offset = high.frames.positions - low.frames.positions
    frames = Frames(low.frames.positions + share[:, None, None] * offset, rotations)
    part = share[:, None, None]
    between = {
        name: getattr(low, name) + part * (getattr(high, name) - getattr(low, name))
        for name in ("input_jacobian", "eigenstrain_jacobian")
    }
    strains, converged = segments.strains(frames), low.converged & high.converged
    return ArmResponse(frames, converged, low.chambers, strains=strains, **between)

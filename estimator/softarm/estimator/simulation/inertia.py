"""How the arm vibrates about its quasi-static answer: a few hertz, in strain coordinates.

With q the strains of all segments, q_s what they would be at rest and K the stiffness against their couples,
gravity's share included, M q'' + D q' + K (q - q_s) = 0 about every pose. M is that of the kinetic energy of
sections and segments: with J the derivative of a point's place by q, the sum of m J^T J. A segment counts
with a sixth of its mass at either end and the rest at the middle of its arc (Simpson's rule).
D = a M + b K (J. W. Strutt, The Theory of Sound, 1877). Steps in time are those of N. M. Newmark (J. Eng.
Mech. Div. ASCE 85, 1959) with constant average acceleration, which neither damp nor diverge.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import eigh

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.rotations import skew
from softarm.estimator.simulation.segments import Neighbours, Segments
from softarm.estimator.specimen import Specimen

FINE = 0.02
"""Longest step in time [s]."""
PAUSE = 1.0
"""A gap [s] after which the arm counts as at rest."""
GYRATION = 0.01
"""Radius of gyration of a rigid section about its axes [m]."""
ARC_MIDDLE = 0.25
"""Share of the lower end's displacement that the middle of a bending arc takes part in."""
USUAL = 0.1
"""Mass of a segment that nobody weighed [kg]."""


@dataclass(frozen=True)
class Masses:
    """Masses that vibrate.

    Args:
        sections: Of the rigid sections whose frames are known [kg], shape (sections,).
        segments: Of the segments [kg], shape (segments,).
    """

    sections: Floats
    segments: Floats

    @classmethod
    def of(cls, specimen: Specimen, sections: tuple[str, ...], segments: tuple[str, ...]) -> "Masses":
        """Take them from a specimen."""
        return cls(
            np.array([specimen.section(name).mass_kg or 0.0 for name in sections]),
            np.array([specimen.segment(name).mass_kg or USUAL for name in segments]),
        )


@dataclass(frozen=True)
class ModalDynamics:
    """The matrices of the vibration along a response, in the strains of all segments.

    Args:
        stiffness: K, shape (samples, strains, strains).
        mass: M, of the same shape.
    """

    stiffness: Floats
    mass: Floats

    @classmethod
    def of(cls, response: ArmResponse, segments: Segments, masses: Masses) -> "ModalDynamics":
        """Reduce the arm to its strains in every pose."""
        frames = response.frames
        samples, sections = frames.positions.shape[:2]
        rows = segments.rows(frames).reshape(samples, -1, 6 * sections)
        stable = _stable(rows @ response.load_jacobian @ np.swapaxes(rows, 1, 2), response.converged)
        by_wrench = _filled(response.load_jacobian, stable)
        turned = by_wrench @ np.swapaxes(rows, 1, 2)
        compliance = rows @ turned
        stiffness = np.asarray(np.linalg.inv(0.5 * (compliance + np.swapaxes(compliance, 1, 2))), np.float64)
        by_strain = (turned @ stiffness).reshape(samples, sections, 6, -1)
        return cls(stiffness, mass_matrix(frames, segments.neighbours, masses, by_strain))

    def frequencies(self, sample: int = 0) -> Floats:
        """Return the natural frequencies about the pose of one sample [Hz], rising."""
        slowness = eigh(self.mass[sample], self.stiffness[sample], eigvals_only=True)[::-1]
        frequencies: Floats = 1.0 / (2.0 * np.pi * np.sqrt(slowness[slowness > 0.0]))
        return frequencies

    def strains(self, clock: Floats, still: Floats, damping: tuple[float, float], mass: float) -> Floats:
        """Let the arm vibrate about quasi-static strains.

        Args:
            clock: Middle of the window of each sample [s], shape (samples,).
            still: Quasi-static strains, shape (samples, strains).
            damping: a [1/s] and b [s].
            mass: Factor on all masses.

        Returns:
            Means over the windows, shape (samples, strains).
        """
        heavy = mass * self.mass
        resisting = damping[0] * heavy + damping[1] * self.stiffness
        found: Floats = _newmark(clock, np.ascontiguousarray(still), self.stiffness, heavy, resisting)
        return found


def _stable(compliance: Floats, converged: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the samples at a stable equilibrium, shape (samples,).

    Beyond the pressures that a model was fitted to, its compliance may have negative eigenvalues: such an arm
    would not vibrate but leave its pose without bound.
    """
    stable = converged & np.isfinite(compliance).all(axis=(1, 2))
    symmetric = 0.5 * (compliance + np.swapaxes(compliance, 1, 2))
    stable[stable] = np.linalg.eigvalsh(symmetric[stable])[:, 0] > 0.0
    return stable


def _filled(by_wrench: Floats, converged: NDArray[np.bool_]) -> Floats:
    """Take the typical compliance where the model found no stable equilibrium."""
    if converged.all() or not converged.any():
        return by_wrench
    return np.where(converged[:, None, None], by_wrench, np.median(by_wrench[converged], axis=0))


def mass_matrix(frames: Frames, neighbours: Neighbours, masses: Masses, twists: Floats) -> Floats:
    """Return the mass matrix in some coordinates of the arm, shape (samples, coordinates, coordinates).

    Args:
        frames: Of the sections, in every sample.
        neighbours: Which sections lie above and below each segment.
        masses: Of sections and segments.
        twists: Derivative of the sections' twists by the coordinates, shape (samples, sections, 6,
            coordinates).
    """
    places, turns = twists[:, :, :3], twists[:, :, 3:]
    moved = [*np.moveaxis(places, 1, 0), *np.moveaxis(GYRATION * turns, 1, 0)]
    weights = [*masses.sections, *masses.sections]
    for mass, (above, below) in zip(masses.segments, neighbours, strict=True):
        lower = places[:, below]
        if above >= 0:
            upper, chord = places[:, above], frames.positions[:, below] - frames.positions[:, above]
            carried = -skew(chord) @ turns[:, above]
        else:
            upper, carried = np.zeros_like(lower), np.zeros_like(lower)
        middle = upper + 0.5 * carried + ARC_MIDDLE * (lower - upper - carried)
        moved += [upper, middle, lower]
        weights += [mass / 6.0, 4.0 * mass / 6.0, mass / 6.0]
    rows = np.sqrt(np.repeat(weights, 3))[:, None] * np.concatenate(moved, axis=1)
    return np.asarray(np.swapaxes(rows, 1, 2) @ rows)


@njit(cache=True, nogil=True)
def _newmark(clock: Floats, still: Floats, stiffness: Floats, mass: Floats, damping: Floats) -> Floats:
    """Step through the windows of all samples; see ``ModalDynamics.strains``."""
    samples, size = still.shape
    means = np.empty((samples, size))
    half = 0.5 * (clock[1] - clock[0]) if samples > 1 else 0.5
    time = clock[0] - half
    place, speed, push = still[0].copy(), np.zeros(size), np.zeros(size)
    for k in range(samples):
        end = 0.5 * (clock[k] + clock[k + 1]) if k + 1 < samples else clock[k] + half
        if end - time > PAUSE:
            place, speed, push = still[k].copy(), np.zeros(size), np.zeros(size)
            means[k], time = place, end
            continue
        steps = max(1, int(np.ceil((end - time) / FINE - 1e-6)))
        h = (end - time) / steps
        inverse = np.linalg.inv(mass[k] + 0.5 * h * damping[k] + 0.25 * h * h * stiffness[k])
        total = np.zeros(size)
        for step in range(1, steps + 1):
            goal = _between(clock, still, k, time + h * step)
            ahead = place + h * speed + 0.25 * h * h * push
            gained = speed + 0.5 * h * push
            push = inverse @ (stiffness[k] @ (goal - ahead) - damping[k] @ gained)
            speed = gained + 0.5 * h * push
            there = ahead + 0.25 * h * h * push
            total += 0.5 * (place + there)
            place = there
        means[k], time = total / steps, end
    return means


@njit(cache=True, nogil=True)
def _between(clock: Floats, values: Floats, k: int, time: float) -> Floats:
    """Interpolate near sample k."""
    before, after = k, k
    if time <= clock[k] and k > 0:
        before = k - 1
    elif time > clock[k] and k + 1 < len(clock):
        after = k + 1
    share = 0.0 if before == after else (time - clock[before]) / (clock[after] - clock[before])
    between: Floats = values[before] + share * (values[after] - values[before])
    return between

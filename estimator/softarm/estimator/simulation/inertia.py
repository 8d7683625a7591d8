"""How the arm vibrates about its quasi-static answer: a few hertz, in strain coordinates.

With q the strains of all segments, q_s what they would be at rest and K the stiffness against their couples,
gravity's share included, M q'' + D q' + K (q - q_s) = 0 about every pose. M is that of the kinetic energy of
sections and segments: with J the derivative of a point's place by q, the sum of m J^T J. A segment counts
with a sixth of its mass at either end and the rest at the middle of its arc (Simpson's rule).
D = a M + b K (J. W. Strutt, The Theory of Sound, 1877). Steps in time are those of N. M. Newmark (J. Eng.
Mech. Div. ASCE 85, 1959) with constant average acceleration, which neither damp nor diverge.

On a compliant base its rotations r about x and y are two more coordinates. With C the compliance, G what a
rotation changes of q_s, since gravity rotates in the base frame, and k the moment of the weights about the
base by r at constant strains, the potential is

    V = (q - q_s)^T K (q - q_s) / 2 - (q - q_s)^T K G r + r^T (1 / C + k) r / 2.

The base has d / C of damping, d being its damping time. D is the arm's alone: rubber damps what strains it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import eigh

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.sensing.measurement import rigid_motion
from softarm.estimator.simulation.segments import Neighbours, Segments
from softarm.estimator.small_matrices import invert, product
from softarm.estimator.specimen import Specimen
from softarm.estimator.vectors import cross

FINE = 0.02
"""Longest step in time [s]."""
PAUSE = 1.0
"""A gap [s] after which the arm counts as at rest."""
GYRATION = 0.01
"""Radius of gyration of a rigid section about its axes [m]."""
ARC_MIDDLE = 0.25
"""Displacement of the middle of a bending arc over that of its lower end."""
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
        """Read them from a specimen."""
        return cls(
            np.array([specimen.section(name).mass_kg or 0.0 for name in sections]),
            np.array([specimen.segment(name).mass_kg or USUAL for name in segments]),
        )


@dataclass(frozen=True)
class StrainDynamics:
    """The matrices of the vibration along a response, in the strains of all segments.

    Args:
        stiffness: K, shape (samples, strains, strains).
        inertia: Mass matrix in the strains and, where it is known, in rotations of the base about x and y
            behind them, shape (samples, coordinates, coordinates).
        rubber: What the segments have of it, of the same shape.
        places: Derivative of the sections' origins by these coordinates, shape (samples, sections, 3,
            coordinates).
        stable: Samples at a stable equilibrium, shape (samples,); the others have typical matrices.
        elastic: Stiffness of the material: of the arm without weight and pressures, shape (strains,).
        drag: Damping beside that in proportion to M and K, of the shape of ``stiffness``; ``None`` for none.
        damped: K in proportion to which it damps, of that shape; ``None`` for ``stiffness`` itself.
    """

    stiffness: Floats
    inertia: Floats
    rubber: Floats
    places: Floats
    stable: Flags
    elastic: Floats
    drag: Floats | None = None
    damped: Floats | None = None

    @property
    def mass(self) -> Floats:
        """M, in the coordinates of ``stiffness`` and of its shape."""
        size = self.stiffness.shape[-1]
        return self.inertia[:, :size, :size]

    @property
    def damped_stiffness(self) -> Floats:
        """K in proportion to which the arm damps, of the shape of ``stiffness``."""
        return self.stiffness if self.damped is None else self.damped

    @classmethod
    def of(
        cls, response: ArmResponse, segments: Segments, masses: Masses, elastic: Floats
    ) -> "StrainDynamics":
        """Reduce the arm to its strains in every pose.

        Args:
            response: Of the arm, with derivatives.
            segments: The segments.
            masses: Masses that vibrate.
            elastic: Stiffness of the material, shape (strains,).
        """
        frames = response.frames
        samples, sections = frames.positions.shape[:2]
        twist_by_couple, stiffness, stable = strain_stiffness(response, segments)
        by_strain = (twist_by_couple @ stiffness).reshape(samples, sections, 6, -1)
        turns = rigid_motion(frames).reshape(samples, sections, 6, 6)[..., 3:5]
        twists = np.concatenate([by_strain, turns], axis=-1)
        rubber = replace(masses, sections=np.zeros_like(masses.sections))
        whole, soft = (_mass_on_a_base(frames, segments.neighbours, one, twists) for one in (masses, rubber))
        return cls(stiffness, whole, soft, np.ascontiguousarray(twists[:, :, :3]), stable, elastic)

    def times(self, factor: float) -> "StrainDynamics":
        """Return the matrices of an arm with all masses times a factor."""
        return replace(self, inertia=factor * self.inertia, rubber=factor * self.rubber)

    def frequencies(self, sample: int = 0) -> Floats:
        """Return the natural frequencies about the pose of one sample [Hz], rising."""
        slowness = eigh(self.mass[sample], self.stiffness[sample], eigvals_only=True)[::-1]
        frequencies: Floats = 1.0 / (2.0 * np.pi * np.sqrt(slowness[slowness > 0.0]))
        return frequencies

    def heavier(self, ratio: float, added: Floats) -> "StrainDynamics":
        """Return the matrices of an arm with other masses.

        Args:
            ratio: Factor on the segments' masses: the density of rubber is less certain than what was
                made in one piece and weighed.
            added: To the sections [kg], shape (sections,).
        """
        rows = np.sqrt(np.maximum(added, 0.0))[:, None, None] * self.places
        rows = rows.reshape(len(rows), -1, rows.shape[-1])
        more = (ratio - 1.0) * self.rubber + np.swapaxes(rows, 1, 2) @ rows
        return replace(self, inertia=self.inertia + more)

    def slower(self, strains: Flags, inertia_time: float, damping_time: float) -> "StrainDynamics":
        """Return the matrices of an arm with more inertia and damping of some strains.

        A material that is viscous as Kelvin and Voigt have it stays so whatever it is strained by, and weight
        adds to the stiffness of an arm that hangs, but damps nothing.

        Args:
            strains: Which ones, shape (strains,).
            inertia_time: a [s]: a^2 of the stiffness of their material is added to the masses.
            damping_time: d [s]: d of it is added to the damping.
        """
        part = np.diag(self.elastic * strains)
        drag = damping_time * part + (np.zeros_like(self.stiffness) if self.drag is None else self.drag)
        size, inertia = len(part), self.inertia.copy()
        inertia[:, :size, :size] += inertia_time**2 * part
        return replace(self, inertia=inertia, drag=drag)

    def stiffer(self, strains: Flags, factor: Floats) -> "StrainDynamics":
        """Return the matrices of an arm of another stiffness of some strains.

        Damping stays as it is: what damps an arm need not be what makes it stiff.

        Args:
            strains: Which ones, shape (strains,).
            factor: On their stiffness, shape (samples,).
        """
        more = (factor - 1.0)[:, None, None] * self.stiffness * np.outer(strains, strains)
        return replace(self, stiffness=self.stiffness + more, damped=self.damped_stiffness)

    def scaled(self, stiffness: Floats, damping_times: Floats) -> "StrainDynamics":
        """Return the matrices of an arm with other entries of the stiffness, and more damping.

        Args:
            stiffness: Factors on the stiffness, shape (strains, strains).
            damping_times: What is added to the damping, over the stiffness of before [s], of the same shape.
        """
        drag = damping_times * self.stiffness + (0.0 if self.drag is None else self.drag)
        return replace(self, stiffness=stiffness * self.stiffness, damped=self.damped_stiffness, drag=drag)

    def on_a_base(
        self, compliance: float, damping_time: float, by_rotation: Floats, restoring: Floats
    ) -> "StrainDynamics":
        """Return the matrices of an arm on a compliant base, whose rotations are two more coordinates.

        The base damps by itself; the arm damps what changes its strains, and not that it turns with the base.

        Args:
            compliance: C, positive [rad/(N m)].
            damping_time: Damping of the base over its stiffness [s].
            by_rotation: G, shape (samples, strains, 2).
            restoring: k [N m/rad], shape (samples, 2, 2).
        """
        assert self.inertia.shape[-1] == self.stiffness.shape[-1] + 2
        coupling = -self.stiffness @ by_rotation
        base = np.eye(2) / compliance + restoring
        stiffness = _bordered(self.stiffness, coupling, base)
        apart, none = np.zeros_like(coupling), np.zeros_like(base)
        damped = _bordered(self.damped_stiffness, apart, none)
        own = np.zeros_like(self.stiffness) if self.drag is None else self.drag
        drag = _bordered(own, apart, none + damping_time / compliance * np.eye(2))
        return replace(self, stiffness=stiffness, drag=drag, damped=damped)

    def strains(self, clock: Floats, still: Floats, damping: tuple[float, float]) -> Floats:
        """Let the arm vibrate about quasi-static strains.

        Args:
            clock: Middle of the window of each sample [s], shape (samples,).
            still: Quasi-static strains, shape (samples, strains).
            damping: a [1/s] and b [s].

        Returns:
            Means over the windows, shape (samples, strains).
        """
        return self.integrator(clock, damping)(still)

    def integrator(self, clock: Floats, damping: tuple[float, float]) -> Callable[[Floats], Floats]:
        """Prepare ``strains`` for many motions."""
        edges = _edges(clock)
        lengths = np.diff(edges)
        steps = np.where(lengths > PAUSE, 0, np.maximum(np.ceil(lengths / FINE - 1e-6), 1.0)).astype(np.int64)
        resisting = damping[0] * self.mass + damping[1] * self.damped_stiffness
        resisting = resisting if self.drag is None else resisting + self.drag
        spring, drag = np.empty(self.mass.shape), np.empty(self.mass.shape)
        _accelerations(lengths / np.maximum(steps, 1), self.mass, resisting, self.stiffness, spring, drag)
        return partial(_integrated, clock, edges, steps, spring, drag)


@dataclass(frozen=True)
class VibratingArm:
    """An arm that vibrates, along a recording.

    Args:
        clock: Middle of the window of each sample [s], shape (samples,).
        dynamics: How it vibrates.
        damping: Shares of the masses [1/s] and of the stiffness [s] that damp.
        delay: By how much motion follows what drives it later than it should [s].
        valid: Samples at which the quasi-static strains are known, shape (samples,).
        unloaded: Those of them at which no known load holds the arm, shape (samples,).
    """

    clock: Floats
    dynamics: StrainDynamics
    damping: tuple[float, float]
    delay: float
    valid: Flags
    unloaded: Flags

    def lag(self, still: Floats) -> Floats:
        """Return by how much strains vibrate about quasi-static ones, shape (samples, strains, ...)."""
        if not self.valid.any():
            return np.zeros_like(still)
        before, after, share = self._delayed
        wide = (-1, *(1,) * (still.ndim - 1))
        late = still[before] + share.reshape(wide) * (still[after] - still[before])
        return np.where(self.unloaded.reshape(wide), self._integrate(late) - still, 0.0)

    @cached_property
    def _delayed(self) -> tuple[Indices, Indices, Floats]:
        """Known samples before and after what drives the arm at each sample, and the share of the later."""
        valid, wanted = np.flatnonzero(self.valid), self.clock - self.delay
        after = np.clip(np.searchsorted(self.clock[valid], wanted), 1, max(len(valid) - 1, 1))
        before, after = valid[after - 1], valid[np.minimum(after, len(valid) - 1)]
        wide = np.maximum(self.clock[after] - self.clock[before], 1e-12)
        share = np.clip((wanted - self.clock[before]) / wide, 0.0, 1.0)
        return before, after, share

    @cached_property
    def _integrate(self) -> Callable[[Floats], Floats]:
        return self.dynamics.integrator(self.clock, self.damping)

    def couples(self, lag: Floats) -> Floats:
        """Return the couples that strain the arm at rest so, shape (samples, strains)."""
        couples: Floats = np.einsum("tij,tj->ti", self.dynamics.stiffness, lag)
        return couples

    def heavier(self, ratio: float, added: Floats) -> "VibratingArm":
        """Return it with other masses; see ``StrainDynamics.heavier``."""
        return replace(self, dynamics=self.dynamics.heavier(ratio, added))

    def slower(self, strains: Flags, inertia_time: float, damping_time: float) -> "VibratingArm":
        """Return it with more inertia and damping of some strains; see ``StrainDynamics.slower``."""
        return replace(self, dynamics=self.dynamics.slower(strains, inertia_time, damping_time))

    def on_a_base(
        self, compliance: float, damping_time: float, by_rotation: Floats, restoring: Floats
    ) -> "VibratingArm":
        """Return it on a compliant base; see ``StrainDynamics.on_a_base``."""
        dynamics = self.dynamics.on_a_base(compliance, damping_time, by_rotation, restoring)
        return replace(self, dynamics=dynamics)

    def scaled(self, stiffness: Floats, damping_times: Floats) -> "VibratingArm":
        """Return it with another stiffness and damping; see ``StrainDynamics.scaled``."""
        return replace(self, dynamics=self.dynamics.scaled(stiffness, damping_times))

    def stiffer(self, strains: Flags, factor: Floats) -> "VibratingArm":
        """Return it with another stiffness of some strains; see ``StrainDynamics.stiffer``."""
        return replace(self, dynamics=self.dynamics.stiffer(strains, factor))


def strain_stiffness(response: ArmResponse, segments: Segments) -> tuple[Floats, Floats, Flags]:
    """Return how the segments' couples move the sections, and the stiffness against them, in every pose.

    Returns:
        Derivative of the sections' twists by the couples, shape (samples, 6 sections, strains); K, shape
        (samples, strains, strains); and the samples at a stable equilibrium, shape (samples,): the others
        have typical values, or NaN for K where no sample is at one.
    """
    samples, sections = response.frames.positions.shape[:2]
    rows = segments.rows(response.frames).reshape(samples, -1, 6 * sections)
    stable = _stable(rows @ response.load_jacobian @ np.swapaxes(rows, 1, 2), response.converged)
    twist_by_couple = _filled(response.load_jacobian, stable) @ np.swapaxes(rows, 1, 2)
    compliance = rows @ twist_by_couple
    if not stable.any():
        return twist_by_couple, np.full_like(compliance, np.nan), stable
    stiffness = np.linalg.inv(0.5 * (compliance + np.swapaxes(compliance, 1, 2)))
    return twist_by_couple, np.asarray(stiffness, dtype=np.float64), stable


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
    """Fill in the typical compliance where the model found no stable equilibrium."""
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
    matrix = np.zeros((len(twists), twists.shape[-1], twists.shape[-1]))
    mass_kernel(
        np.ascontiguousarray(frames.positions), np.ascontiguousarray(twists),
        np.array(neighbours, dtype=np.int64).reshape(-1, 2), masses.sections, masses.segments, matrix,
    )  # fmt: skip
    return matrix


def _mass_on_a_base(frames: Frames, neighbours: Neighbours, masses: Masses, twists: Floats) -> Floats:
    """Return the mass matrix where the base moves: the last two coordinates rotate all about x and y."""
    samples, sections = frames.positions.shape[:2]
    positions = np.concatenate([frames.positions, np.zeros((samples, 1, 3))], axis=1)
    rotations = np.concatenate([frames.rotations, np.broadcast_to(np.eye(3), (samples, 1, 3, 3))], axis=1)
    whole = np.zeros((samples, sections + 1, *twists.shape[2:]))
    whole[:, :sections] = twists
    whole[:, sections, 3:5, -2:] = np.eye(2)
    above, below = np.array(neighbours).reshape(-1, 2).T
    held = tuple(zip(np.where(above < 0, sections, above).tolist(), below.tolist(), strict=True))
    heavy = replace(masses, sections=np.append(masses.sections, 0.0))
    return mass_matrix(Frames(positions, rotations), held, heavy, whole)


def _bordered(matrix: Floats, sides: Floats, corner: Floats) -> Floats:
    """Put symmetric matrices together: [[matrix, sides], [sides^T, corner]], each with the samples first."""
    upper = np.concatenate([matrix, sides], axis=2)
    lower = np.concatenate([np.swapaxes(sides, 1, 2), corner], axis=2)
    whole: Floats = np.concatenate([upper, lower], axis=1)
    return whole


@njit(cache=True, nogil=True)
def mass_kernel(
    positions: Floats, twists: Floats, neighbours: Indices, sections: Floats, segments: Floats, matrix: Floats
) -> None:
    """Add m J^T J of every section and of three points of every segment, see the head of this file."""
    columns = twists.shape[3]
    upper, lower, carried = np.zeros((3, columns)), np.zeros((3, columns)), np.zeros((3, columns))
    middle, arm = np.zeros((3, columns)), np.empty(3)
    for n in range(len(twists)):
        for k in range(len(sections)):
            _add_weight(sections[k], twists[n, k, :3], matrix[n])
            _add_weight(sections[k] * GYRATION**2, twists[n, k, 3:], matrix[n])
        for k in range(len(segments)):
            above, below = neighbours[k]
            lower[:] = twists[n, below, :3]
            upper.fill(0.0)
            carried.fill(0.0)
            if above >= 0:
                upper[:] = twists[n, above, :3]
                for c in range(columns):
                    for r in range(3):
                        arm[r] = positions[n, below, r] - positions[n, above, r]
                    cross(twists[n, above, 3:, c], arm, carried[:, c])
            for r in range(3):
                for c in range(columns):
                    bent = lower[r, c] - upper[r, c] - carried[r, c]
                    middle[r, c] = upper[r, c] + 0.5 * carried[r, c] + ARC_MIDDLE * bent
            _add_weight(segments[k] / 6.0, upper, matrix[n])
            _add_weight(4.0 * segments[k] / 6.0, middle, matrix[n])
            _add_weight(segments[k] / 6.0, lower, matrix[n])


@njit(cache=True, nogil=True)
def _add_weight(mass: float, moved: Floats, matrix: Floats) -> None:
    """Add what a mass with these displacements per coordinate, shape (3, coordinates), contributes."""
    for r in range(len(matrix)):
        for c in range(len(matrix)):
            for k in range(3):
                matrix[r, c] += mass * moved[k, r] * moved[k, c]


def _edges(clock: Floats) -> Floats:
    """Return where the windows of samples begin and end [s], shape (samples + 1,)."""
    half = 0.5 * (clock[1] - clock[0]) if len(clock) > 1 else 0.5
    return np.concatenate([clock[:1] - half, 0.5 * (clock[1:] + clock[:-1]), clock[-1:] + half])


@njit(cache=True, nogil=True)
def _accelerations(
    h: Floats, mass: Floats, resisting: Floats, stiffness: Floats, spring: Floats, drag: Floats
) -> None:
    """Fill the accelerations at the end of a time step by what pulls then, and by each speed.

    They are S = A^-1 K and A^-1 D with A = M + h D / 2 + h^2 K / 4.

    Args:
        h: Length of the time steps of each sample [s], shape (samples,).
        mass: M, shape (samples, strains, strains).
        resisting: D, of the same shape.
        stiffness: K, of the same shape.
        spring: Filled with S^T, of the same shape.
        drag: Filled with (A^-1 D)^T, of the same shape.
    """
    size = mass.shape[1]
    implicit, inverse = np.empty((size, size)), np.empty((size, size))
    for n in range(len(mass)):
        for r in range(size):
            for c in range(size):
                damped = mass[n, r, c] + 0.5 * h[n] * resisting[n, r, c]
                implicit[r, c] = damped + 0.25 * h[n] * h[n] * stiffness[n, r, c]
        invert(implicit, inverse)
        product(inverse, stiffness[n], spring[n].T)
        product(inverse, resisting[n], drag[n].T)


def _integrated(
    clock: Floats, edges: Floats, steps: NDArray[np.int64], spring: Floats, drag: Floats, still: Floats
) -> Floats:
    motions = np.swapaxes(still.reshape(*still.shape[:2], -1), 1, 2)
    integrated = _newmark(clock, edges, steps, spring, drag, np.ascontiguousarray(motions))
    return np.swapaxes(integrated, 1, 2).reshape(still.shape)


@njit(cache=True, nogil=True)
def _newmark(
    clock: Floats, edges: Floats, steps: NDArray[np.int64], spring: Floats, drag: Floats, still: Floats
) -> Floats:
    """Step through the windows of all samples; no steps stand for a pause. See ``StrainDynamics.strains``.

    ``spring`` and ``drag`` are as of ``_accelerations``, ``still`` has the shape (samples, motions, strains).
    """
    samples, motions, size = still.shape
    means = np.zeros((samples, motions, size))
    place, speed, push = still[0].copy(), np.zeros((motions, size)), np.zeros((motions, size))
    ahead, gained, pull = np.empty(size), np.empty(size), np.empty(size)
    acceleration = np.empty(size)
    for k in range(samples):
        if steps[k] == 0:
            place[:], speed[:], push[:] = still[k], 0.0, 0.0
            means[k] = place
            continue
        h = (edges[k + 1] - edges[k]) / steps[k]
        for step in range(1, steps[k] + 1):
            before, after, share = _between(clock, k, edges[k] + h * step)
            for c in range(motions):
                for i in range(size):  # arrays made in every step would take most of the time
                    goal = still[before, c, i] + share * (still[after, c, i] - still[before, c, i])
                    ahead[i] = place[c, i] + h * speed[c, i] + 0.25 * h * h * push[c, i]
                    gained[i] = speed[c, i] + 0.5 * h * push[c, i]
                    pull[i] = goal - ahead[i]
                    acceleration[i] = 0.0
                for j in range(size):
                    pull_j, gained_j = pull[j], gained[j]
                    for i in range(size):  # neighbours in memory, which are added at once
                        acceleration[i] += spring[k, j, i] * pull_j - drag[k, j, i] * gained_j
                for i in range(size):
                    push[c, i] = acceleration[i]
                    speed[c, i] = gained[i] + 0.5 * h * acceleration[i]
                    there = ahead[i] + 0.25 * h * h * acceleration[i]
                    means[k, c, i] += 0.5 * (place[c, i] + there)
                    place[c, i] = there
        means[k] /= steps[k]
    return means


@njit(cache=True, nogil=True)
def _between(clock: Floats, k: int, time: float) -> tuple[int, int, float]:
    """Find the samples to interpolate between near sample k, and the share of the second."""
    if time <= clock[k] and k > 0:
        return k - 1, k, (time - clock[k - 1]) / (clock[k] - clock[k - 1])
    if time > clock[k] and k + 1 < len(clock):
        return k, k + 1, (time - clock[k]) / (clock[k + 1] - clock[k])
    return k, k, 0.0

"""From one equilibrium to another along a path of loads."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem.assembly import Body
from softarm.estimator.fem.linalg.cholesky import StiffnessFactor
from softarm.estimator.fem.statics.equilibrium import (
    Balance,
    Balancer,
    Corrected,
    Settings,
    correct,
    descend,
    longest_move,
    size_of,
)
from softarm.estimator.fem.statics.solution import Solution, SolveStatus
from softarm.estimator.model import Inputs

SNAP = 0.02
"""Fraction of the change of load by which a snap-through is overstepped."""


@dataclass(frozen=True)
class Waypoint:
    """An equilibrium on the path.

    Args:
        fraction: How far along the path, 0 to 1.
        displacement: [m], shape (nodes, 3).
        velocity: Its derivative by the fraction [m], shape (nodes, 3).
    """

    fraction: float
    displacement: Floats
    velocity: Floats


def between(first: Inputs, second: Inputs, fraction: float) -> Inputs:
    """Interpolate inputs."""
    return Inputs(
        first.pressures + fraction * (second.pressures - first.pressures),
        first.loads + fraction * (second.loads - first.loads),
        first.gravity + fraction * (second.gravity - first.gravity),
    )


def extrapolate(body: Body, last: Waypoint, before: Waypoint | None, fraction: float) -> Floats:
    """Predict an equilibrium ahead: by a finite rotation from one waypoint, by Hermite's cubic from two."""
    ahead = fraction - last.fraction
    if before is None:
        rotation_strain = body.rotation_strain
        deformation = rotation_strain.deformation(last.displacement)
        return rotation_strain.moved(last.displacement, deformation, ahead * last.velocity)
    span = last.fraction - before.fraction
    t = 1.0 + ahead / span
    return (
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * before.displacement
        + t * (1.0 - t) ** 2 * span * before.velocity
        + t**2 * (3.0 - 2.0 * t) * last.displacement
        + t**2 * (t - 1.0) * span * last.velocity
    )


def path_velocity(
    body: Body, nodal_mass: Floats, balance: Balance, factor: StiffnessFactor, origin: Inputs, target: Inputs
) -> Floats:
    """Solve K du = df for the change of the applied forces from one end of a path to the other [m]."""
    force = np.tensordot(target.pressures - origin.pressures, balance.evaluation.gradients, 1)
    force += np.tensordot(target.loads - origin.loads, balance.load_vectors, 1)
    force += np.outer(nodal_mass, target.gravity - origin.gravity)
    return body.pattern.scatter(factor.solve(body.pattern.gather(force)))


Search = Callable[[Body, Balancer, Floats, Inputs, Settings], Corrected]


class EquilibriumPath:
    """The walk along a straight path of inputs, step by step.

    Args:
        balancer: Evaluates its forces.
        origin: Inputs at fraction 0.
        target: Inputs at fraction 1.
        nodal_mass: Mass of each node [kg], shape (nodes,).
        settings: Limits.
    """

    def __init__(
        self,
        body: Body,
        balancer: Balancer,
        origin: Inputs,
        target: Inputs,
        nodal_mass: Floats,
        settings: Settings,
    ) -> None:
        self._body, self._balancer, self._settings = body, balancer, settings
        self._origin, self._target = origin, target
        self._nodal_mass = nodal_mass
        self._before: Waypoint | None = None
        self._last: Waypoint | None = None
        self._spent = 0

    def walk(self, start: Floats) -> Solution[Floats]:
        """Walk from the displacement under ``origin`` to that under ``target``.

        A step that fails is halved, one that succeeds quickly is doubled. Where even the smallest step fails
        the arm snaps through: the next equilibrium is sought downhill. A path that cannot be continued ends
        with the status of its last failure at the last equilibrium reached.
        """
        corrected = self._solve(correct, start, 0.0)
        if not corrected.solution.converged and self._settings.descent:
            corrected = self._solve(descend, start, 0.0)
        if not corrected.solution.converged:
            return self._end(start, corrected.solution.status)
        self._arrive(0.0, corrected)
        step, status = self._first_step(), SolveStatus.CONVERGED
        while self._here.fraction < 1.0:
            aim = min(1.0, self._here.fraction + step)
            predicted = extrapolate(self._body, self._here, self._before, aim)
            corrected = self._solve(correct, predicted, aim)
            if corrected.solution.converged:
                self._arrive(aim, corrected)
                # Few iterations mean that the prediction was good, and that a longer step will do.
                count = corrected.solution.iterations
                step *= 2.0 if count <= 4 else 1.2 if count <= 6 else 0.7
                if self._spent >= self._settings.total_iterations and aim < 1.0:
                    return self._end(self._here.displacement, SolveStatus.ITERATIONS)
                continue
            status = corrected.solution.status
            # Less than half, so that doubling after one success does not lead back to the aim that failed.
            step = 0.4 * (aim - self._here.fraction)
            if self._spent >= self._settings.total_iterations:
                return self._end(self._here.displacement, SolveStatus.ITERATIONS)
            if step < self._settings.smallest_step:
                if not self._settings.descent:
                    return self._end(self._here.displacement, status)
                aim = min(1.0, self._here.fraction + SNAP)
                corrected = self._solve(descend, self._here.displacement, aim)
                if not corrected.solution.converged:
                    return self._end(self._here.displacement, status)
                # The equilibria beyond a snap do not continue those before: nothing is extrapolated across
                # it.
                self._last = None
                self._arrive(aim, corrected)
                step = SNAP
        return self._end(self._here.displacement, SolveStatus.CONVERGED)

    @property
    def _here(self) -> Waypoint:
        assert self._last is not None
        return self._last

    @property
    def fraction(self) -> float:
        """Fraction of the path that has been walked."""
        return 0.0 if self._last is None else self._last.fraction

    def _solve(self, search: Search, start: Floats, fraction: float) -> Corrected:
        inputs = between(self._origin, self._target, fraction)
        corrected = search(self._body, self._balancer, start, inputs, self._settings)
        self._spent += corrected.solution.iterations
        return corrected

    def _arrive(self, fraction: float, corrected: Corrected) -> None:
        assert corrected.factor is not None
        velocity = path_velocity(
            self._body, self._nodal_mass, corrected.balance, corrected.factor, self._origin, self._target
        )
        self._before, self._last = self._last, Waypoint(fraction, corrected.solution.value, velocity)

    def _first_step(self) -> float:
        """Choose the whole path, or as much as moves no node farther than a step may."""
        reach = self._settings.longest_move * size_of(self._body)
        return min(1.0, reach / max(longest_move(self._here.velocity), 1e-300))

    def _end(self, displacement: Floats, status: SolveStatus) -> Solution[Floats]:
        # Against the target, wherever the walk ended: it measures how far that is from the target.
        norm = self._balancer(displacement, self._target, False).norm
        return Solution(displacement, status, self._spent, norm)

"""The forces on an arm that moves, from estimates that hold it for one at rest."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.dynamics.force_filter import ForceFilter
from softarm.estimator.dynamics.force_memory import ForceMemory
from softarm.estimator.dynamics.reduced_arm import ReducedArm, Reduction
from softarm.estimator.inverse import ArmEstimate
from softarm.estimator.model import Load
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.sensing.model_error import vented
from softarm.estimator.simulation.inertia import Masses
from softarm.estimator.simulation.segments import Neighbours, neighbours_of
from softarm.estimator.specimen import Specimen, Value

COARSE = 1.0
"""Phase [rad] of the slowest vibration between two instants beyond which they do not show it."""


class MovingForces:
    """Removes the arm's inertia and damping from its estimated forces.

    An estimate treats an arm that vibrates as one at rest, held in its pose by a force of mass times
    acceleration. The forces and poses of a sequence of estimates separate that force from a real one.

    Args:
        sections: Names of the sections of the model.
        neighbours: Sections above and below each segment.
        masses: Of sections and segments.
        loads: The unknown loads; where they are not all forces on sections, estimates stay as they are.
        suite: The sensors with their own noise.
        memory: Share of a force that the arm remembers once it is over, by section.
    """

    def __init__(
        self,
        sections: tuple[str, ...],
        neighbours: Neighbours,
        masses: Masses,
        loads: Sequence[Load],
        suite: SensorSuite,
        memory: Mapping[str, Value] | None = None,
    ) -> None:
        self._suite = suite
        self._remembered = ForceMemory(loads, memory or {})
        self._reduction: Reduction | None = None
        if loads and all(load.kind == "force" and load.section is not None for load in loads):
            self._reduction = Reduction.of(loads, sections, neighbours, masses)
        self._filter: ForceFilter | None = None
        self._time = -np.inf
        self._last: ReducedArm | None = None

    @classmethod
    def of(
        cls, specimen: Specimen, sections: tuple[str, ...], loads: Sequence[Load], suite: SensorSuite
    ) -> "MovingForces":
        """Read masses and their places from a specimen."""
        masses = Masses.of(specimen, sections, tuple(part.name for part in specimen.segments))
        memory = specimen.calibration.force_memory
        return cls(sections, neighbours_of(specimen, sections), masses, loads, suite, memory)

    def reset(self) -> None:
        """Forget the past."""
        self._filter = None
        self._remembered.reset()

    def tare(self) -> None:
        """Begin a new history of the forces at the last instant; see ``ForceMemory``."""
        self._remembered.tare()

    def update(self, time: float, readings: Floats, estimate: ArmEstimate[Any]) -> tuple[Floats, Floats]:
        """Return the forces without the arm's inertia and what it remembers of larger ones.

        Args:
            time: Of the estimate [s].
            readings: That it was made from, stacked, shape (readings,).
            estimate: Of an arm at rest.

        Returns:
            Amplitudes of the loads, shape (loads,), and their covariance, shape (loads, loads). They are
            those of the estimate where it starts anew: at first, after a search that failed, or after
            a pause in which the arm may have swung.
        """
        forces, covariance = self._without_inertia(time, readings, estimate)
        if estimate.status == "diverged":
            return forces, covariance
        pressurised = not vented(estimate.measured_pressures)
        forces, remembered = self._remembered.update(forces, pressurised=pressurised)
        return forces, covariance + remembered

    def _without_inertia(
        self, time: float, readings: Floats, estimate: ArmEstimate[Any]
    ) -> tuple[Floats, Floats]:
        """Return the forces without the arm's inertia, and their covariance; see ``update``."""
        plain = estimate.inputs.loads, estimate.load_covariance
        arm = None
        if self._reduction is not None and estimate.status != "diverged":
            arm = self._reduction.at(estimate, self._suite.sensor_noise(readings))
        if arm is None:
            self._filter = None
            return plain
        seconds, self._time = time - self._time, time
        last, self._last = self._last, arm
        if self._filter is None or last is None or not 0.0 < seconds * arm.slowest < COARSE:
            self._filter = ForceFilter.begin(arm)
            return plain
        if not np.array_equal(arm.members, last.members):
            # No force at rest bends the arm as its inertia does, so that other readings find it elsewhere.
            self._filter = self._filter.shifted(arm, max(1.0, arm.misfit, last.misfit))
        self._filter = self._filter.at(arm, seconds)
        forces, covariance = self._filter.forces
        return forces, plain[1] + covariance

"""The interface between a fake arm and the fake instruments: inputs, snapshot, protocol."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from softarm.estimator.arrays import Floats

STAGE_SPEED = 0.02
"""How fast the stage of the gauge moves its hook [m/s]."""


@dataclass(frozen=True)
class Cord:
    """A cord of fixed length from a section's origin to the hook of the force gauge; slack when too long.

    Args:
        section: Rigid section it is tied to.
        hook: Position of the gauge's hook in the laboratory frame [m], shape (3,).
        length: Length between knot and hook when just taut [m].
    """

    section: str
    hook: tuple[float, float, float]
    length: float


@dataclass(frozen=True)
class Hand:
    """A hand on the arm: a force, and with a stiffness above zero a spring that draws towards a position.

    Args:
        section: Rigid section it holds.
        force: Force in the laboratory frame [N], shape (3,).
        position: Where the spring draws the section's origin, laboratory frame [m], shape (3,).
        stiffness: Stiffness of the spring [N/m]; 0 for a pure force.
    """

    section: str
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stiffness: float = 0.0


@dataclass(frozen=True)
class PlantInputs:
    """What drives the arm; held constant over a step.

    Args:
        valve_pressures: Gauge pressures at the valve outlets, in chamber order [Pa], shape (chambers,).
        cord: The cord to the force gauge, if one is tied.
        hand: A hand on the arm, if any.
    """

    valve_pressures: Floats
    cord: Cord | None = None
    hand: Hand | None = None


@dataclass(frozen=True)
class PlantState:
    """A snapshot of the arm, true values without sensor noise.

    The laboratory frame is that of the motion capture. Quaternions (w, x, y, z) rotate section coordinates
    into laboratory coordinates.

    Args:
        time: Time of the snapshot [s] on the fakes' one clock.
        chamber_pressures: Gauge pressures in the chambers, behind the lines [Pa], shape (chambers,).
        positions: Origins of the sections in the laboratory frame [m], shape (sections, 3).
        quaternions: Orientations of the sections, shape (sections, 4).
        angular_velocities: In the section's own frame [rad/s], shape (sections, 3).
        specific_forces: What an ideal accelerometer on the section reads, in its own frame [m/s2]; at rest
            it is 9.81 upwards. Shape (sections, 3).
        bends: Tilt of each section's z axis seen in the section above it, angle times direction
            (theta cos phi, theta sin phi) [rad], shape (segments, 2).
        cord_force: Pull in the cord [N], 0 when slack.
        external_forces: Sum of cord, hand and contact forces on each section, laboratory frame [N],
            shape (sections, 3); the truth an estimate is scored against.
    """

    time: float
    chamber_pressures: Floats
    positions: Floats
    quaternions: Floats
    angular_velocities: Floats
    specific_forces: Floats
    bends: Floats
    cord_force: float = 0.0
    external_forces: Floats = field(default_factory=lambda: np.zeros((0, 3)))


class Plant(Protocol):
    """A fake arm: a function of time and inputs with its own memory; it reads no wall clock."""

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the rigid sections, from the base to the tip; the first one is clamped."""

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the soft segments, one fewer than sections."""

    @property
    def chambers(self) -> int:
        """Number of chambers."""

    @property
    def state(self) -> PlantState:
        """The snapshot at the end of the last step; it is made on request."""

    def advance(self, time: float, inputs: PlantInputs) -> None:
        """Step to ``time`` [s] under constant inputs.

        Args:
            time: Not earlier than the last step; the plant takes as many internal steps as it needs.
            inputs: What drives it meanwhile.
        """

    def switch(self, effect: str, value: object) -> None:
        """Set one concealed effect at run time.

        Args:
            effect: Its name.
            value: Its new magnitude, in the unit the plant documents.

        Raises:
            InputError: The plant has no such effect, or the value does not fit it.
        """

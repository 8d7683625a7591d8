"""A small arm without dynamics, for wires that are tested without a physics engine."""

import math

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.fakes.faults import nearest
from softarm.fakes.plant.state import PlantInputs, PlantState
from softarm.fakes.rotation import Quaternion, Vector, conjugate, multiply, rotate

GRAVITY = 9.80665
SEGMENT_LENGTH = 0.145
"""From section to section [m]."""
AZIMUTHS = (0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)


class StillArm:
    """A hanging arm of constant-curvature segments with three chambers each.

    Pressures reach the chambers after a first-order lag and bend a segment away from the pressurised
    chamber by ``gain`` [rad/Pa]; forces do not move it. The laboratory frame has z up and its origin at the
    base.
    """

    sections = ("base", "intermediate", "tip")
    segments = ("upper", "lower")
    chambers = 6

    def __init__(self) -> None:
        self.effects = {"gain": 1.0e-5, "lag": 0.02, "cord_stiffness": 2000.0}
        self._pressures = np.zeros(self.chambers)
        self.state = self._snapshot(0.0, np.zeros((len(self.segments), 2)), None)

    def advance(self, time: float, inputs: PlantInputs) -> None:
        """Step to ``time`` [s]."""
        step = time - self.state.time
        lag = self.effects["lag"]
        share = 1.0 - math.exp(-step / lag) if lag > 0 else 1.0
        self._pressures = self._pressures + share * (inputs.valve_pressures - self._pressures)
        self.state = self._snapshot(time, self._bends(), inputs)

    def switch(self, effect: str, value: object) -> None:
        """Set ``gain`` [rad/Pa], ``lag`` [s] or ``cord_stiffness`` [N/m]."""
        if effect not in self.effects:
            raise InputError("plant", f"no effect {effect!r}", nearest(effect, self.effects))
        if isinstance(value, bool) or not isinstance(value, int | float) or value < 0:
            raise InputError(f"plant, {effect}", f"value {value!r}", "give a number not below 0")
        self.effects[effect] = float(value)

    def _bends(self) -> Floats:
        gain = self.effects["gain"]
        pressures = self._pressures.reshape(-1, 3)
        towards = np.array([[-math.cos(a), -math.sin(a)] for a in AZIMUTHS])
        bends: Floats = gain * pressures @ towards
        return bends

    def _snapshot(self, time: float, bends: Floats, inputs: PlantInputs | None) -> PlantState:
        rotation: Quaternion = (0.0, 1.0, 0.0, 0.0)
        origin = (0.0, 0.0, 0.0)
        positions, quaternions = [origin], [rotation]
        for bend in bends:
            shift, tilt = _arc(float(bend[0]), float(bend[1]), SEGMENT_LENGTH)
            moved = rotate(rotation, shift)
            origin = (origin[0] + moved[0], origin[1] + moved[1], origin[2] + moved[2])
            rotation = multiply(rotation, tilt)
            positions.append(origin)
            quaternions.append(rotation)
        forces = np.zeros((len(self.sections), 3))
        cord_force = self._pull(np.array(positions), forces, inputs)
        return PlantState(
            time=time,
            chamber_pressures=self._pressures,
            positions=np.array(positions),
            quaternions=np.array(quaternions),
            angular_velocities=np.zeros((len(self.sections), 3)),
            specific_forces=np.array([rotate(conjugate(q), (0.0, 0.0, GRAVITY)) for q in quaternions]),
            bends=bends,
            cord_force=cord_force,
            external_forces=forces,
        )

    def _pull(self, positions: Floats, forces: Floats, inputs: PlantInputs | None) -> float:
        """Add the forces of cord and hand to ``forces``; return the pull in the cord [N]."""
        if inputs is None:
            return 0.0
        if inputs.hand is not None:
            forces[self.sections.index(inputs.hand.section)] += inputs.hand.force
        if inputs.cord is None:
            return 0.0
        section = self.sections.index(inputs.cord.section)
        span = np.array(inputs.cord.hook) - positions[section]
        distance = float(np.linalg.norm(span))
        pull = self.effects["cord_stiffness"] * max(0.0, distance - inputs.cord.length)
        if pull > 0:
            forces[section] += pull * span / distance
        return pull


def _arc(bend_x: float, bend_y: float, length: float) -> tuple[Vector, Quaternion]:
    """Return the end of a circular arc, its chord and its rotation, in the frame of its start."""
    angle = math.hypot(bend_x, bend_y)
    if angle < 1e-9:
        return (0.0, 0.0, length), (1.0, 0.0, 0.0, 0.0)
    across, along = (1.0 - math.cos(angle)) / angle, math.sin(angle) / angle
    unit_x, unit_y = bend_x / angle, bend_y / angle
    half = math.sin(angle / 2.0)
    tilt = (math.cos(angle / 2.0), -half * unit_y, half * unit_x, 0.0)
    return (length * across * unit_x, length * across * unit_y, length * along), tilt

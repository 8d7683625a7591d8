"""A measurement: frames at the camera rate, with what cameras and operators do to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.plant.state import PlantState
from softarm.fakes.qtm.packets import MeasuredFrame, PacketBody
from softarm.fakes.rotation import Quaternion, Vector, from_rotation_vector, matrix, multiply, rotate
from softarm.fakes.signals import See, plainly

MILLIMETRES = 1e3
QUIET_NAN = float("nan")


@dataclass(frozen=True)
class MarkerBody:
    """A rigid body of markers.

    Args:
        name: Its name in the settings.
        section: Rigid section of the arm that carries it.
        offset: Its origin in the section's frame [m].
        rotation: Its axes in the section's frame, as a rotation vector [rad].
        misalignment: Rotation vector by which its mount differs from the section's frame [rad].
    """

    name: str
    section: str
    offset: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)
    misalignment: Vector = (0.0, 0.0, 0.0)

    @property
    def axes(self) -> Quaternion:
        """Rotation from the body's axes to the section's."""
        return multiply(from_rotation_vector(self.misalignment), from_rotation_vector(self.rotation))


@dataclass(frozen=True)
class Cameras:
    """What the camera system is like.

    Args:
        rate: Frames per second.
        position_noise: Standard deviation of a coordinate [m].
        angle_noise: Standard deviation of an angle [rad].
        clock_ppm: How much too fast the camera clock runs.
    """

    rate: float = 100.0
    position_noise: float = 3e-5
    angle_noise: float = 3e-4
    clock_ppm: float = 0.0


def measurement_faults(bodies: Sequence[str]) -> tuple[Fault, ...]:
    """List what can go wrong in the frames.

    Args:
        bodies: Names of the bodies.
    """
    return (
        Fault(
            "body_lost",
            "named bodies have all bits set",
            parameters={"bodies": bodies[-1]},
            limits={"bodies": tuple(bodies)},
        ),
        Fault("all_lost", "every body is lost and half of the camera frames are dropped"),
        Fault(
            "nan_body",
            "named bodies are ordinary quiet NaN instead of all bits set",
            parameters={"bodies": bodies[-1]},
            limits={"bodies": tuple(bodies)},
        ),
        Fault(
            "drop_rate",
            "the component header reports dropped camera frames",
            parameters={"per_mille": 150},
            limits={"per_mille": (0, 1000)},
        ),
        Fault("frame_gap", "frame numbers jump", True, {"frames": 7}, {"frames": (1, 100000)}),
        Fault(
            "restart",
            "a new measurement: time stamp and frame number begin again; announced or in mid-stream",
            once=True,
            parameters={"announced": False},
        ),
        Fault("frozen_preview", "the frame number stays 1 and the time stamp stands still"),
    )


class MotionMeasurement:
    """Turns snapshots of the arm into frames.

    Args:
        bodies: The bodies, in the order of the settings.
        sections: Names of the arm's sections.
        cameras: The camera system.
        faults: The board with at least ``measurement_faults``.
        seed: Seed of the noise.
        see: What is concealed in a ``pose``.
    """

    def __init__(
        self,
        bodies: Sequence[MarkerBody],
        sections: Sequence[str],
        cameras: Cameras,
        faults: FaultBoard,
        seed: int = 0,
        see: See = plainly,
    ) -> None:
        self._see = see
        self.bodies = list(bodies)
        self.cameras = cameras
        self.start_time = 0.0
        self._sections = list(sections)
        self._faults = faults
        self._random = np.random.default_rng(seed)
        self._number = 0

    def start(self, time: float) -> None:
        """Begin a new measurement at ``time`` [s]."""
        self.start_time = time
        self._number = 0

    def next_time(self) -> float:
        """Return the time of the next exposure [s] on the fakes' clock."""
        return self.start_time + (self._number + 1) / (
            self.cameras.rate * (1 + 1e-6 * self.cameras.clock_ppm)
        )

    def capture(self, state: PlantState) -> MeasuredFrame | None:
        """Measure the next frame of a snapshot; None when it is the first of a gap."""
        if gap := self._faults.hit("frame_gap"):
            self._number += int(gap["frames"])
            return None
        self._number += 1
        if self._faults.hit("frozen_preview"):
            time_us, number = 0, 1
        else:
            time_us, number = round(self._number * 1e6 / self.cameras.rate), self._number
        lost = self._named("body_lost")
        rate = self._faults.hit("drop_rate")
        drop_rate = int(rate["per_mille"]) if rate else 0
        if self._faults.hit("all_lost"):
            lost, drop_rate = {body.name for body in self.bodies}, 500
        empty = self._named("nan_body")
        poses = [
            None if body.name in lost else _nothing() if body.name in empty else self._pose(body, state)
            for body in self.bodies
        ]
        return MeasuredFrame(time_us, number, poses, drop_rate)

    def skip_to(self, time: float) -> None:
        """Leave out the frames whose exposure is more than a second past, as QTM does when late."""
        behind = int((time - self.next_time()) * self.cameras.rate)
        if behind > self.cameras.rate:
            self._number += behind

    def _named(self, fault: str) -> set[str]:
        """Return the bodies that a fault strikes; it shows only if one of them is in the project."""
        active = self._faults.active(fault)
        struck = (
            {body.name for body in self.bodies} & set(str(active["bodies"]).split(",")) if active else set()
        )
        if struck:
            self._faults.hit(fault)
        return struck

    def _pose(self, body: MarkerBody, state: PlantState) -> PacketBody:
        index = self._sections.index(body.section)
        true = np.concatenate([state.positions[index], state.quaternions[index]])
        measured = self._see("pose", f"frame_{body.section}", state.time, true)
        w, x, y, z = (float(c) for c in measured[3:])
        section: Quaternion = (w, x, y, z)
        origin = measured[:3] + np.array(rotate(section, body.offset))
        noise = self._random.standard_normal(7)
        origin = (origin + self.cameras.position_noise * noise[:3]) * MILLIMETRES
        wobble = from_rotation_vector(tuple(self.cameras.angle_noise * noise[3:6]))
        rows = matrix(multiply(multiply(section, body.axes), wobble))
        by_columns = tuple(rows[row][column] for column in range(3) for row in range(3))
        residual = abs(float(noise[6])) * self.cameras.position_noise * MILLIMETRES
        return PacketBody((float(origin[0]), float(origin[1]), float(origin[2])), by_columns, residual)


def _nothing() -> PacketBody:
    return PacketBody((QUIET_NAN,) * 3, (QUIET_NAN,) * 9, QUIET_NAN)

"""A measurement: frames at the camera rate, with what cameras and operators do to them."""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import BodyPart, QtmPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.qtm.packets import MeasuredFrame, PacketBody
from softarm.fakes.rotation import Quaternion, columns, from_rotation_vector, multiply, rotate
from softarm.fakes.signals import SignalFilter

MILLIMETRES = 1e3
QUIET_NAN = float("nan")


def measurement_faults(bodies: Sequence[str]) -> tuple[Fault, ...]:
    """List what can go wrong in the frames."""
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
    """Converts snapshots of the arm to frames.

    Args:
        part: The motion capture.
        sections: Names of the arm's sections.
        misalignments: Rotation vector of the mount on each named section [rad].
        faults: The board with at least ``measurement_faults``.
        seed: Seed of the noise.
        signal_filter: What is concealed in a ``pose``.
    """

    def __init__(
        self,
        part: QtmPart,
        sections: Sequence[str],
        misalignments: Mapping[str, Floats],
        faults: FaultBoard,
        seed: int,
        signal_filter: SignalFilter,
    ) -> None:
        self.part = part
        self.bodies = list(part.bodies)
        self.start_time = 0.0
        self._signal_filter = signal_filter
        self._sections = list(sections)
        self._axes = {body.name: _axes(body, misalignments) for body in part.bodies}
        self._faults = faults
        self._random = np.random.default_rng(seed)
        self._number = 0

    def start(self, time: float) -> None:
        """Begin a new measurement at ``time`` [s]."""
        self.start_time = time
        self._number = 0

    def next_time(self) -> float:
        """Return the time of the next exposure [s] on the fakes' clock."""
        return self.start_time + (self._number + 1) / (self.part.rate_hz * (1 + 1e-6 * self.part.clock_ppm))

    def capture(self, state: PlantState) -> MeasuredFrame | None:
        """Measure the next frame of a snapshot; None when it is the first of a gap."""
        if gap := self._faults.hit("frame_gap"):
            self._number += int(gap["frames"])
            return None
        self._number += 1
        if self._faults.hit("frozen_preview"):
            time_us, number = 0, 1
        else:
            time_us, number = round(self._number * 1e6 / self.part.rate_hz), self._number
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
        behind = int((time - self.next_time()) * self.part.rate_hz)
        if behind > self.part.rate_hz:
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

    def _pose(self, body: BodyPart, state: PlantState) -> PacketBody:
        index = self._sections.index(body.section)
        true = np.concatenate([state.positions[index], state.quaternions[index]])
        x, y, z, *quaternion = self._signal_filter("pose", f"frame_{body.section}", state.time, true).tolist()
        section: Quaternion = (quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        dx, dy, dz = rotate(section, body.offset_m)
        noise = self._random.standard_normal(7).tolist()
        spread, angle = self.part.position_noise_m, self.part.angle_noise_rad
        wobble = from_rotation_vector((angle * noise[3], angle * noise[4], angle * noise[5]))
        return PacketBody(
            (
                MILLIMETRES * (x + dx + spread * noise[0]),
                MILLIMETRES * (y + dy + spread * noise[1]),
                MILLIMETRES * (z + dz + spread * noise[2]),
            ),
            columns(multiply(multiply(section, self._axes[body.name]), wobble)),
            MILLIMETRES * spread * abs(noise[6]),
        )


def _axes(body: BodyPart, misalignments: Mapping[str, Floats]) -> Quaternion:
    """Return the rotation from a body's axes to those of its section."""
    x, y, z = misalignments.get(body.section, np.zeros(3)).tolist()
    return multiply(from_rotation_vector((x, y, z)), from_rotation_vector(body.rotation_rad))


def _nothing() -> PacketBody:
    return PacketBody((QUIET_NAN,) * 3, (QUIET_NAN,) * 9, QUIET_NAN)

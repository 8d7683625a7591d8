"""Translates the messages of an arm to ROS 2; knows the types of ROS 2 by their names only."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from softarm_client.messages import Estimate, LoadEstimate, SectionPose, State, Vector
from softarm_client.ros.interface import TOPICS, ros_name

SOLVED = "converged", "degraded"
"""States of the estimator in which its poses and forces hold."""
FRESH_NS = 500_000_000
"""Poses are left out once the last estimate is so much older than the state that repeats them."""
KEPT = 64
"""Estimates kept to find the one of a state's poses: more than the service makes between two states."""
ARROW_M_PER_N = 0.15
SHAFT_M, HEAD_M = 0.006, 0.015
RED = {"r": 0.75, "g": 0.125, "b": 0.0, "a": 1.0}
NAN = math.nan
Quaternion = tuple[float, float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
NO_ROTATION: Quaternion = (1.0, 0.0, 0.0, 0.0)

Types = Callable[[str], Any]
"""Finds the class of a ROS 2 message, such as ``std_msgs/msg/Bool``, which takes its fields by name."""


@dataclass(frozen=True)
class Outgoing:
    """A message for a topic.

    Args:
        topic: Name below the arm's namespace, or absolute.
        type: Type of the message.
    """

    topic: str
    type: str
    message: Any


class ArmMessages:
    """Translates states and estimates of one arm.

    Poses come with the states, and only while the estimator solves: they carry the time of the readings that
    they were estimated from. What is lost or not estimated is left out or NaN.

    Args:
        arm: The arm's name, which becomes that of its base frame.
        types: Finds the classes of ROS 2.
        transforms: Whether ``/tf`` is published.
    """

    def __init__(self, arm: str, types: Types, transforms: bool = True) -> None:
        self.frame = ros_name(arm)
        self._types = types
        self._transforms = transforms
        self._estimates: tuple[Estimate, ...] = ()
        self._state_ns = 0
        self._placed_ns = 0

    def of_estimate(self, estimate: Estimate) -> Iterator[Outgoing]:
        """Translate the forces of an estimate; nothing where it failed, or is the last one of long ago."""
        self._estimates = (*self._estimates[1 - KEPT :], estimate)
        if estimate.status not in SOLVED or self._state_ns - estimate.stamp.unix_ns > FRESH_NS:
            return
        unix_ns = _measured_ns(estimate)
        for load in estimate.loads:
            section = ros_name(load.section)
            force, torque = self._vector(_force(load)), self._vector((NAN, NAN, NAN))
            wrench = self._make("geometry_msgs/msg/Wrench", force=force, torque=torque)
            yield self._stamped("wrench", unix_ns, section=section, wrench=wrench)
            yield self._stamped("force_std", unix_ns, section=section, vector=self._vector(_std(load)))
        yield self._plain("in_contact", data=estimate.in_contact)

    def of_state(self, state: State) -> Iterator[Outgoing]:
        """Translate mode, pressures and, while they are fresh, poses; a lost pressure is left out."""
        self._state_ns = state.stamp.unix_ns
        yield self._plain("mode", data=str(state.mode))
        pressures = {"measured": state.measured_pa, "asked": state.asked_pa, "applied": state.applied_pa}
        for topic, values in pressures.items():
            for chamber, pressure in enumerate(values):
                if pressure is not None:
                    yield self._pressure(topic, state.stamp.unix_ns, chamber, pressure)
        estimate = self._estimate_of(state)
        if estimate is not None:
            yield from self._places(state.sections, _measured_ns(estimate))
            yield self._arrows(estimate)

    def _pressure(self, topic: str, unix_ns: int, chamber: int, pressure: float) -> Outgoing:
        return self._stamped(topic, unix_ns, chamber=chamber, fluid_pressure=pressure, variance=0.0)

    def _estimate_of(self, state: State) -> Estimate | None:
        """Return the estimate that a state's poses are from; none when it failed, is old or was placed."""
        made_ns = state.stamp.unix_ns
        before = [estimate for estimate in self._estimates if estimate.stamp.unix_ns <= made_ns]
        if not before or before[-1].status not in SOLVED:
            return None
        estimate_ns = before[-1].stamp.unix_ns
        if made_ns - estimate_ns > FRESH_NS or estimate_ns <= self._placed_ns:
            return None
        self._placed_ns = estimate_ns
        return before[-1]

    def _places(self, sections: tuple[SectionPose, ...], unix_ns: int) -> Iterator[Outgoing]:
        for place in sections:
            pose = self._pose(place.position_m, place.quaternion_wxyz)
            section = ros_name(place.section)
            yield self._stamped("pose", unix_ns, section=section, pose=pose)
            if place.position_std_m is not None and place.rotation_std_rad is not None:
                variances = _diagonal((*place.position_std_m, *place.rotation_std_rad))
                both = self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=variances)
                yield self._stamped("pose_with_covariance", unix_ns, section=section, pose=both)
        if self._transforms:
            frames = [frame for place in sections for frame in self._frames(place, unix_ns)]
            yield self._plain("transforms", transforms=frames)

    def _frames(self, place: SectionPose, unix_ns: int) -> Iterator[Any]:
        child = f"{self.frame}/{ros_name(place.section)}"
        header, origin = self._header(self.frame, unix_ns), self._vector(place.position_m)
        for name, wxyz in ((child, place.quaternion_wxyz), (f"{child}/load", NO_ROTATION)):
            rotation = self._quaternion(wxyz)
            transform = self._make("geometry_msgs/msg/Transform", translation=origin, rotation=rotation)
            kind = "geometry_msgs/msg/TransformStamped"
            yield self._make(kind, header=header, child_frame_id=name, transform=transform)

    def _arrows(self, estimate: Estimate) -> Outgoing:
        """Draw forces; each arrow vanishes by itself when no other follows."""
        frame_at, marker = TOPICS["forces"].frame_at, self._types("visualization_msgs/msg/Marker")
        seconds = self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=FRESH_NS)
        arrows = [
            marker(
                header=self._header(
                    frame_at(self.frame, section=ros_name(load.section)), _measured_ns(estimate)
                ),
                ns="force",
                id=index,
                type=marker.ARROW,
                action=marker.ADD,
                pose=self._pose(ORIGIN),
                points=[self._point(ORIGIN), self._point(_arrow(load))],
                scale=self._vector((SHAFT_M, HEAD_M, 0.0)),
                color=self._make("std_msgs/msg/ColorRGBA", **RED),
                lifetime=seconds,
            )
            for index, load in enumerate(estimate.loads)
        ]
        return self._plain("forces", markers=arrows)

    def _pose(self, position: Vector, wxyz: Quaternion = NO_ROTATION) -> Any:
        point, orientation = self._point(position), self._quaternion(wxyz)
        return self._make("geometry_msgs/msg/Pose", position=point, orientation=orientation)

    def _stamped(
        self, topic: str, unix_ns: int, chamber: int = 0, section: str = "", **fields: object
    ) -> Outgoing:
        entry = TOPICS[topic]
        header = self._header(entry.frame_at(self.frame, section=section), unix_ns)
        message = self._make(entry.type, header=header, **fields)
        return Outgoing(entry.at(chamber=chamber, section=section), entry.type, message)

    def _plain(self, topic: str, **fields: object) -> Outgoing:
        entry = TOPICS[topic]
        return Outgoing(entry.name, entry.type, self._make(entry.type, **fields))

    def _header(self, frame: str, unix_ns: int) -> Any:
        return self._make("std_msgs/msg/Header", stamp=time_of(self._types, unix_ns), frame_id=frame)

    def _vector(self, values: Vector) -> Any:
        return self._make("geometry_msgs/msg/Vector3", x=values[0], y=values[1], z=values[2])

    def _point(self, values: Vector) -> Any:
        return self._make("geometry_msgs/msg/Point", x=values[0], y=values[1], z=values[2])

    def _quaternion(self, wxyz: Quaternion) -> Any:
        w, x, y, z = wxyz
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _make(self, name: str, **fields: object) -> Any:
        return self._types(name)(**fields)


def time_of(types: Types, unix_ns: int) -> Any:
    """Return a time of ROS 2."""
    sec, nanosec = divmod(unix_ns, 1_000_000_000)
    return types("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)


def _measured_ns(estimate: Estimate) -> int:
    """Return when the newest reading of an estimate arrived, on the wall clock of the service's host."""
    return estimate.stamp.unix_ns - round(estimate.latency_s * 1e9)


def _estimated(load: LoadEstimate) -> tuple[float | None, ...]:
    """Return the variance of each component of a force; ``None`` where it is not estimated."""
    return tuple(load.covariance_n2[axis][axis] for axis in range(3))


def _force(load: LoadEstimate) -> Vector:
    pairs = zip(load.force_n, _estimated(load), strict=True)
    x, y, z = (NAN if variance is None else force for force, variance in pairs)
    return x, y, z


def _std(load: LoadEstimate) -> Vector:
    x, y, z = (NAN if variance is None else math.sqrt(max(variance, 0.0)) for variance in _estimated(load))
    return x, y, z


def _arrow(load: LoadEstimate) -> Vector:
    x, y, z = (ARROW_M_PER_N * force for force in load.force_n)
    return x, y, z


def _diagonal(std: tuple[float, ...]) -> list[float]:
    """Return a covariance without correlations, row by row."""
    size = len(std)
    return [std[row] ** 2 if row == column else 0.0 for row in range(size) for column in range(size)]

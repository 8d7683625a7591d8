"""What the node offers in ROS 2, by name and type: ``python -m softarm_client.ros.interface`` prints it."""

import re
from dataclasses import dataclass

TRANSFORMS = "tf2_msgs/msg/TFMessage"
"""Type of ``/tf``, which the wheels of PyPI lack and every installation of ROS 2 has."""


@dataclass(frozen=True)
class RosTopic:
    """A topic that the node publishes.

    Args:
        name: Name below the arm's namespace, or absolute; words in angle brackets stand for names.
        type: Type of its messages.
        frame: Frame of the header below the arm's name, empty for the arm's own; ``None`` without a header.
        content: What it carries, with unit.
    """

    name: str
    type: str
    frame: str | None
    content: str

    def at(self, **names: object) -> str:
        """Fill in the words in angle brackets."""
        return _filled(self.name, names)

    def frame_at(self, arm: str, **names: object) -> str:
        """Return the frame of the header."""
        assert self.frame is not None
        return f"{arm}/{_filled(self.frame, names)}" if self.frame else arm


def _filled(pattern: str, names: dict[str, object]) -> str:
    return re.sub(r"<(\w+)>", lambda match: str(names[match[1]]), pattern)


LOAD_FRAME = "<section>/load"
PRESSURE = "sensor_msgs/msg/FluidPressure"
TOPICS = {
    "transforms": RosTopic(
        "/tf", TRANSFORMS, "", "frames `<section>`, and `<section>/load`: same origin, axes of the base"
    ),
    "pose": RosTopic("sections/<section>/pose", "geometry_msgs/msg/PoseStamped", "", "pose of a section [m]"),
    "pose_with_covariance": RosTopic(
        "sections/<section>/pose_with_covariance",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "",
        "the same with its variances [m2, rad2] about the base axes; correlations are 0",
    ),
    "wrench": RosTopic(
        "sections/<section>/wrench",
        "geometry_msgs/msg/WrenchStamped",
        LOAD_FRAME,
        "external force on a section [N]; NaN: not estimated, as every torque",
    ),
    "force_std": RosTopic(
        "sections/<section>/force_std",
        "geometry_msgs/msg/Vector3Stamped",
        LOAD_FRAME,
        "standard deviation of that force [N]; NaN: not estimated",
    ),
    "forces": RosTopic(
        "forces",
        "visualization_msgs/msg/MarkerArray",
        LOAD_FRAME,
        "the forces as arrows for RViz, 0.15 m/N; axes that are not estimated drawn as 0",
    ),
    "in_contact": RosTopic(
        "in_contact", "std_msgs/msg/Bool", None, "whether an external force exceeds the noise"
    ),
    "measured": RosTopic(
        "chambers/chamber_<chamber>/measured", PRESSURE, "", "measured pressure [Pa], gauge"
    ),
    "asked": RosTopic(
        "chambers/chamber_<chamber>/asked", PRESSURE, "", "set-point that was asked for [Pa], gauge"
    ),
    "applied": RosTopic(
        "chambers/chamber_<chamber>/applied", PRESSURE, "", "set-point after limits and slew [Pa], gauge"
    ),
    "mode": RosTopic("mode", "std_msgs/msg/String", None, "mode of the service, such as `HOLDING`"),
    "diagnostics": RosTopic(
        "/diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        None,
        "service, estimator, model, and every input and device; once a second",
    ),
}
"""Every topic that the node publishes."""

SET_PRESSURES = "set_pressures"
SUBSCRIBED = {
    SET_PRESSURES: ("std_msgs/msg/Float64MultiArray", "gauge pressures to ask for [Pa], one per chamber"),
}
"""Every topic that the node subscribes to, with type and content."""

SERVICES = {
    "stop": "vents at once and latches a fault; open to all, in every mode, ahead of all other commands",
    "lease/acquire": "the node acquires the lease and renews it until `lease/release` or its end",
    "lease/release": "releases the lease; an arm under pressure vents",
    "arm": "lets the valves accept set-points; needs the lease",
    "disarm": "vents; needs the lease",
    "clear": "leaves FAULTED once the cause is gone",
    "estimate/tare": "takes the present force as zero",
    "calibrate/rest": "aligns inertial units with the model while the arm hangs vented and free",
    "teach/start": "lets the arm be moved by hand; needs the lease",
    "teach/hold": "ramps to the pressures that hold the present pose, in `ramp_s`; needs the lease",
    "teach/save": "saves the present pose under `pose_name`",
    "teach/goto/<pose>": "ramps to that saved pose in `ramp_s` and holds it; needs the lease",
    "teach/release": "ends teaching or holding; needs the lease",
    "experiment/begin": "begins an experiment, in which set-points are accepted; needs the lease",
    "experiment/end": "ends it; needs the lease",
    "record/start": "records every stream on the service's host under `recording_name`",
    "record/stop": "ends the recording; its file is complete when the service answers",
}
"""Every service, all of type ``std_srvs/srv/Trigger``."""

PARAMETERS: dict[str, tuple[float | str, str]] = {
    "ramp_s": (2.0, "length of the ramp of `teach/hold` and `teach/goto` [s]"),
    "pose_name": ("pose", "name under which `teach/save` saves"),
    "recording_name": ("recording", "name of the file of `record/start`"),
    "set_point_lifetime_s": (1.0, "the arm vents unless the next set-point comes within this time [s]"),
}
"""Every parameter, with default and meaning."""


def ros_name(name: str) -> str:
    """Turn a name into one that ROS 2 takes: letters, digits and underscores, no digit first."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{plain}" if plain[:1].isdigit() else plain


def tables() -> str:
    """Write the interface as the tables of ``docs/ros.md``."""
    topics = ((f"`{t.name}`", f"`{t.type}`", t.content) for t in TOPICS.values())
    subscribed = ((f"`{name}`", f"`{kind}`", content) for name, (kind, content) in SUBSCRIBED.items())
    services = ((f"`{name}`", does) for name, does in SERVICES.items())
    parameters = ((f"`{name}`", f"`{default}`", does) for name, (default, does) in PARAMETERS.items())
    return "\n\n".join(
        (
            _table(("published topic", "type", "content"), *topics),
            _table(("subscribed topic", "type", "content"), *subscribed),
            _table(("service (`std_srvs/srv/Trigger`)", "what it does"), *services),
            _table(("parameter", "default", "meaning"), *parameters),
        )
    )


def _table(heading: tuple[str, ...], *rows: tuple[str, ...]) -> str:
    lines = (f"| {' | '.join(line)} |" for line in (heading, *rows))
    return "\n".join((next(lines), f"|{'---|' * len(heading)}", *lines))


if __name__ == "__main__":
    print(tables())

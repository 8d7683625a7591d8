"""What the service answers to each command: the mode after it, and what was applied."""

from softarm_client.messages import Message, SectionPose


class Result(Message):
    """Answer to a command.

    Args:
        mode: Mode of the service after the command.
    """

    mode: str


class AppliedSetpoint(Result):
    """Set-points after a command.

    Args:
        asked_pa: Gauge pressures asked for, one per chamber [Pa].
        lifetime_s: How long they live unless renewed [s]; ``None`` where the answer states none.
    """

    asked_pa: tuple[float, ...]
    lifetime_s: float | None = None


class Cleared(Result):
    """Answer to ``clear``.

    Args:
        cleared: Cause of the fault that was left; ``None`` when there was none.
        acknowledged: Whether errors that valves kept were acknowledged and are still to clear themselves.
    """

    cleared: str | None
    acknowledged: bool


class Pose(Message):
    """Pressures that hold a pose.

    Args:
        pressures_pa: Gauge pressures, one per chamber [Pa].
        reachable: Whether they hold the pose within the sensors' noise.
        note: Why not, in a sentence.
        sections: Section poses when it was saved; only ``teach/list`` states them.
    """

    pressures_pa: tuple[float, ...]
    reachable: bool
    note: str
    sections: tuple[SectionPose, ...] = ()


class Saved(Result, Pose):
    """Answer to ``teach/save``: the pose under its name."""

    name: str


class Hold(Result, Pose):
    """Answer to ``teach/hold`` and ``teach/goto``.

    Args:
        ramp_s: Length of the ramp to the pressures [s].
        name: Name of the saved pose; ``None`` when the present pose is held.
    """

    ramp_s: float
    name: str | None = None


class Tared(Result):
    """Answer to ``estimate/tare``.

    Args:
        loads_n: Components of the force that now count as zero [N].
    """

    loads_n: tuple[float, ...]


class Aligned(Result):
    """Answer to ``calibrate/rest``.

    Args:
        aligned: Sensors that were aligned with the model.
    """

    aligned: tuple[str, ...]


class RecordingStarted(Result):
    """Answer to ``record/start``.

    Args:
        path: File on the service's host.
    """

    path: str


class RecordingEnded(RecordingStarted):
    """Answer to ``record/stop``.

    Args:
        dropped: How many messages were lost because the disk was slow.
    """

    dropped: int


class Reconnected(Result):
    """Answer to ``device/reconnect``.

    Args:
        device: Name of the device.
    """

    device: str

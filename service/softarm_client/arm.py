"""An arm as a client sees it: its streams, its commands, its lease and its recordings."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from pydantic import TypeAdapter

from softarm_client.connection import Connection
from softarm_client.lease import LeasedConnection
from softarm_client.messages import Estimate, Event, Mismatch, State, Surface
from softarm_client.results import (
    Aligned,
    AppliedSetpoint,
    Cleared,
    Hold,
    Pose,
    Reconnected,
    RecordingEnded,
    RecordingStarted,
    Result,
    Saved,
    Tared,
)
from softarm_client.streams import Stream

Kind = TypeVar("Kind", bound=Result)
SILENT_S = 5.0
STALE_S = 0.5
"""A service that was not heard for so long is to be taken as gone."""
SAVE_S = 5.0
"""A pose is on the disk before its command is answered."""
CLOSE_S = 20.0
"""A recording is whole on the disk before its command is answered."""
_POSES = TypeAdapter(dict[str, Pose])


class CommandGroup:
    """A group of commands.

    Args:
        connection: Connection to the arm's service.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def _do(self, verb: str, kind: type[Kind], timeout_s: float = 1.0, **fields: object) -> Kind:
        answer = self._connection.command(verb, timeout_s, **fields)
        return kind.model_validate({**answer.applied, "mode": answer.mode})


class Pressures(CommandGroup):
    """Set-points of the chambers."""

    def set(self, pressures_pa: Sequence[float], lifetime_s: float = 1.0) -> AppliedSetpoint:
        """Ask for gauge pressures; needs the lease.

        Args:
            pressures_pa: One per chamber [Pa].
            lifetime_s: The arm vents unless the next set-point comes within this time [s].

        Returns:
            The set-points that the service took.
        """
        return self._do(
            "set_pressures", AppliedSetpoint, pressures_pa=tuple(pressures_pa), lifetime_s=lifetime_s
        )


class Teach(CommandGroup):
    """Poses taught by hand."""

    def start(self) -> AppliedSetpoint:
        """Let the arm be moved by hand; needs the lease."""
        return self._do("teach/start", AppliedSetpoint)

    def hold(self, ramp_s: float = 2.0) -> Hold:
        """Ramp to the pressures that hold the present pose, and hold it; needs the lease."""
        return self._do("teach/hold", Hold, ramp_s=ramp_s)

    def save(self, name: str) -> Saved:
        """Save the present pose and its pressures under a name."""
        return self._do("teach/save", Saved, SAVE_S, name=name)

    def poses(self) -> dict[str, Pose]:
        """Return the saved poses by name."""
        return _POSES.validate_python(self._connection.command("teach/list").applied)

    def goto(self, name: str, ramp_s: float = 2.0) -> Hold:
        """Ramp to a saved pose and hold it; needs the lease."""
        return self._do("teach/goto", Hold, name=name, ramp_s=ramp_s)

    def release(self) -> AppliedSetpoint:
        """End teaching or holding; needs the lease."""
        return self._do("teach/release", AppliedSetpoint)


class Experiment(CommandGroup):
    """The mode of an experiment, in which set-points are accepted."""

    def begin(self) -> Result:
        """Begin an experiment; needs the lease."""
        return self._do("experiment/begin", Result)

    def end(self) -> Result:
        """End an experiment; needs the lease."""
        return self._do("experiment/end", Result)


class Recordings(CommandGroup):
    """Recordings on the service's host."""

    def start(self, name: str = "recording") -> RecordingStarted:
        """Write every stream to a file from now on."""
        return self._do("record/start", RecordingStarted, name=name)

    def stop(self) -> RecordingEnded:
        """End the recording; its file is complete when this returns."""
        return self._do("record/stop", RecordingEnded, CLOSE_S)


@dataclass
class ActiveRecording:
    """A recording in progress, or ended.

    Args:
        path: File on the service's host.
        dropped: How many messages were lost; ``None`` while it is in progress.
    """

    path: str
    dropped: int | None = None


class Arm(LeasedConnection):
    """One arm and its service, within a block: ``with Arm("sopra") as arm``.

    Args:
        arm: The arm's name.
        endpoint: Where its service, or a router before it, listens.
        name: Name of this client in logs and on the operator page; letters, digits, spaces and ``_.@-``.
        zenoh_config: JSON5 file with credentials and certificates.

    Raises:
        SetupError: The name is not plain, or the file is not valid.
        UnreachableError: Nothing answers at the endpoint.
    """

    _watched = False
    _state_s: float | None = None

    @property
    def state_age_s(self) -> float:
        """Time since the service's last ``state`` arrived [s], infinite before the first.

        The first call begins to watch the stream. The service sends twenty states a second: an age above
        ``STALE_S`` means that service, network or this process stand still, and what was shown is outdated.
        """
        with self._lock:
            if not self._watched:
                self._watched = True
                self._watching.enter_context(self.states().subscribe(self._note_state))
        return float("inf") if self._state_s is None else time.monotonic() - self._state_s

    def _note_state(self, _: State) -> None:
        self._state_s = time.monotonic()

    @property
    def pressures(self) -> Pressures:
        """Commands of the set-points."""
        return Pressures(self)

    @property
    def teach(self) -> Teach:
        """Commands of teaching."""
        return Teach(self)

    @property
    def experiment(self) -> Experiment:
        """Commands of experiments."""
        return Experiment(self)

    @property
    def recordings(self) -> Recordings:
        """Commands of recordings; a block is easier: ``recording``."""
        return Recordings(self)

    def arm(self) -> AppliedSetpoint:
        """Let the valves accept set-points; needs the lease."""
        return CommandGroup(self)._do("arm", AppliedSetpoint)

    def disarm(self) -> AppliedSetpoint:
        """Vent; needs the lease."""
        return CommandGroup(self)._do("disarm", AppliedSetpoint)

    def stop(self) -> AppliedSetpoint:
        """Vent at once and latch a fault; open to all clients, in every mode."""
        return CommandGroup(self)._do("stop", AppliedSetpoint)

    def clear(self) -> Cleared:
        """Leave FAULTED once the cause is gone."""
        return CommandGroup(self)._do("clear", Cleared)

    def tare(self) -> Tared:
        """Take the present external force as zero."""
        return CommandGroup(self)._do("estimate/tare", Tared)

    def align_at_rest(self) -> Aligned:
        """Align inertial units with the model while the arm hangs vented and free."""
        return CommandGroup(self)._do("calibrate/rest", Aligned)

    def reconnect(self, device: str) -> Reconnected:
        """Close a device and connect it again."""
        return CommandGroup(self)._do("device/reconnect", Reconnected, 10.0, device=device)

    def surface(self) -> Surface:
        """Return the arm's outer surface at rest, for drawing the shapes of ``subscribe_shape``."""
        return Surface.model_validate_json(self.ask("surface"))

    def state(self, timeout_s: float = 2.0) -> State:
        """Return the newest state."""
        return self.states().newest(timeout_s)

    def estimate(self, timeout_s: float = 2.0) -> Estimate:
        """Return the newest estimate."""
        return self.estimates().newest(timeout_s)

    def states(self, silent_s: float | None = SILENT_S) -> Stream[State]:
        """Return the stream of states: mode, pressures, poses, health."""
        return Stream(self, "state", State, silent_s)

    def estimates(self, silent_s: float | None = SILENT_S) -> Stream[Estimate]:
        """Return the stream of estimates: forces with their covariance, contact."""
        return Stream(self, "estimate", Estimate, silent_s)

    def mismatches(self, silent_s: float | None = SILENT_S) -> Stream[Mismatch]:
        """Return the stream of the test of the model against the measurements."""
        return Stream(self, "mismatch", Mismatch, silent_s)

    def events(self, silent_s: float | None = None) -> Stream[Event]:
        """Return the stream of events; it may be silent for long, and that is no error."""
        return Stream(self, "event", Event, silent_s)

    @contextmanager
    def recording(self, name: str = "recording") -> Iterator[ActiveRecording]:
        """Record every stream within a block.

        Args:
            name: Name of the file, without suffix.

        Yields:
            The recording: its path and, after the block, how many messages were lost.
        """
        recording = ActiveRecording(self.recordings.start(name).path)
        try:
            yield recording
        finally:
            ended = self.recordings.stop()
            recording.path, recording.dropped = ended.path, ended.dropped

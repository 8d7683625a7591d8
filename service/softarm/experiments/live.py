"""The experiments live over zenoh: manoeuvres through the client, a recording through the service."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.experiments.excitation import specimen_of_arm
from softarm.experiments.operator import ExperimentOperator, FakeOperator, PromptedOperator
from softarm.experiments.rig import PATIENCE, FakeRig, RigSettings, free_endpoint
from softarm.experiments.rig_control import FakeControl, laboratory_of, ramp_pressures
from softarm.experiments.session import connect, recorded, wait_ready
from softarm.recordings import load_recording
from softarm_client import Arm
from softarm_client.session import DEFAULT_ENDPOINT

LIFETIME_S = 5.0
GAUGE_S = 5.0
"""Longest time until a gauge sends its first reading."""


@dataclass(frozen=True)
class HookPlace:
    """Where the gauge's hook was from a time on.

    Args:
        since_s: Time since the recording began [s].
        requested_m: Where it was to be moved, in the base frame [m], NaN while the cord is off.
        measured_m: Where it was measured to be in the laboratory [m].
    """

    since_s: float
    requested_m: Floats
    measured_m: Floats | None = None


@dataclass
class LiveRig:
    """A running arm and who moves what the service cannot.

    Args:
        client: The arm's client, with the lease.
        operator: Moves gauge and hand.
        specimen: What the service runs on.
        advance: Called after each step.
        hooks: Where the gauge's hook was, from when on.
    """

    client: Arm
    operator: ExperimentOperator
    specimen: Specimen
    advance: Callable[[], None] = lambda: None
    hooks: list[HookPlace] = field(default_factory=list)
    _began: float = 0.0
    _pressures: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def now(self) -> float:
        """Time since the recording began [s]."""
        return time.monotonic() - self._began

    def position(self, section: str) -> Floats:
        """Return a section's estimated position in the base frame [m], shape (3,)."""
        for pose in self.client.state().sections:
            if pose.section == section:
                return np.array(pose.position_m)
        raise InputError(self.client.keys.arm, f"publishes no pose of {section}", "see its findings")

    def lost(self) -> list[str]:
        """Name the sensors that the service finds silent, with its advice."""
        silent = (finding for finding in self.client.state().findings if finding.code == "stale_sensor")
        return [f"{finding.where}: {finding.message}; {finding.hint}" for finding in silent]

    def require_gauge(self) -> None:
        """Make sure that the gauge at the tip reads before anybody pulls.

        Raises:
            InputError: It sends no reading.
        """
        try:
            self.client.states().wait_for(lambda s: s.gauges_n.get("tip") is not None, GAUGE_S)
        except TimeoutError:
            raise InputError(
                f"{self.client.keys.arm}, gauge of tip",
                "publishes nothing",
                "switch it on, check its cable and its entry in [[sensors]], then pull anew",
            ) from None

    def go(self, pressures: Floats, ramp_s: float, hold_s: float) -> None:
        """Lead the pressures along a line and hold them."""
        start = self._pressures if len(self._pressures) else np.zeros_like(pressures)
        ramp_pressures(self.client, start.tolist(), pressures.tolist(), ramp_s)
        self._pressures = pressures.copy()
        self.wait(hold_s, pressures)

    def wait(self, seconds: float, pressures: Floats | None = None) -> None:
        """Wait, renewing a set-point that would run out."""
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0.0:
            if pressures is not None:
                self.client.pressures.set(pressures.tolist(), lifetime_s=LIFETIME_S)
            time.sleep(min(remaining, 0.5 * LIFETIME_S))

    def arm(self) -> None:
        """Arm, the chambers vented."""
        self.client.arm()
        self._pressures = np.zeros(len(self.client.state().measured_pa))

    def disarm(self) -> None:
        """Vent and disarm."""
        self.client.disarm()
        self._pressures = np.zeros_like(self._pressures)

    def tie(self, section: str, hook: Floats, length: float) -> None:
        """Tie the cord, or move the gauge."""
        measured = self.operator.tie(section, hook, length)
        self.hooks.append(HookPlace(self.now, hook.copy(), measured))

    def untie(self) -> None:
        """Untie the cord."""
        self.operator.untie()
        self.hooks.append(HookPlace(self.now, np.full(3, np.nan)))

    @contextmanager
    def recording(self, name: str) -> Iterator[list[str]]:
        """Record the block; the list then holds the file's path."""
        self.hooks.clear()
        with recorded(self.client, name) as paths:
            self._began = time.monotonic()
            yield paths

    def load(self, path: str) -> Recording:
        """Load the recording and add where the gauge at the tip was.

        Raises:
            InputError: The recording is on another host, or was not written.
        """
        if not Path(path).exists():
            raise InputError(path, "is not on this machine", "copy it here and run softarm calibrate on it")
        return with_hooks(load_recording(Path(path)), self.hooks, "tip")


def with_hooks(recording: Recording, hooks: Sequence[HookPlace], section: str) -> Recording:
    """Add the hook of the gauge to a recording, as a marker in the laboratory frame."""
    if not hooks:
        return recording
    to_laboratory = base_to_laboratory(recording)
    times = np.array([hook.since_s for hook in hooks])
    places = np.array([to_laboratory(h.requested_m) if h.measured_m is None else h.measured_m for h in hooks])
    last = np.searchsorted(times, recording.time, side="right") - 1
    path = np.where(last[:, None] >= 0, places[np.maximum(last, 0)], np.nan)
    columns = {f"marker_hook_{axis}_m": path[:, index] for index, axis in enumerate("xyz")}
    return replace(
        recording,
        columns={**recording.columns, **columns},
        info={**recording.info, "gauge_section": section},
    )


def base_to_laboratory(recording: Recording) -> Callable[[Floats], Floats]:
    """Return the map from the base frame to that of the recorded poses."""
    if "base" not in recording.frames:
        return lambda points: points
    pose = recording.pose("base")
    first = pose[np.isfinite(pose).all(axis=1)][0]
    rotation = from_quaternions(first[3:])
    return lambda points: points @ rotation.T + first[:3]


@dataclass(frozen=True)
class LiveRigSettings:
    """Where an experiment runs.

    Args:
        out: Folder of everything that it writes.
        arm: Name of a served arm; ``None`` starts fakes.
        endpoint: Where its service listens.
        specimen: Specimen of the fakes' service, and what a served arm's figures rest on; that of the service
            when left out.
        scenario: Scenario of the fakes; that of the demo when left out.
        variant: Which arm the fakes draw; that of the scenario when left out.
        zenoh_config: JSON5 file with credentials for the service.
    """

    out: Path
    arm: str | None = None
    endpoint: str | None = None
    specimen: str | None = None
    scenario: Path | None = None
    variant: int | None = None
    zenoh_config: Path | None = None


@contextmanager
def live_rig(
    settings: LiveRigSettings, ask: Callable[[str], None], sensors: tuple[str, ...] = ("orientation",)
) -> Iterator[LiveRig]:
    """Connect to an arm, or start fakes and a service on them.

    Args:
        settings: Which.
        ask: Shows a person what to do and returns when it is done.
        sensors: Kinds of sensors of the fakes' estimator.
    """
    arm, endpoint, specimen = settings.arm, settings.endpoint, settings.specimen
    if arm is None:
        started = RigSettings(
            settings.scenario or DEMO_SCENARIO,
            specimen=specimen or str(fake_specimen()),
            endpoint=endpoint or free_endpoint(),
            sensors=sensors,
            variant=settings.variant,
            patience=PATIENCE,
        )
        with (
            FakeRig(started, settings.out / "rig") as rig,
            connect(rig) as client,
            live_fakes(rig, client) as live,
        ):
            yield live
    else:
        with Arm(
            arm, endpoint or DEFAULT_ENDPOINT, "experiment", zenoh_config=settings.zenoh_config
        ) as client:
            wait_ready(client)
            described = load_specimen(specimen) if specimen else specimen_of_arm(client)
            with client.lease():
                yield LiveRig(client, PromptedOperator(ask), described)


@contextmanager
def live_fakes(rig: FakeRig, client: Arm) -> Iterator[LiveRig]:
    """Wait until a rig of fakes is ready, and acquire its lease and its control port."""
    wait_ready(client)
    with FakeControl(str(rig.announcement["control"])) as control, client.lease():
        operator = FakeOperator(control, laboratory_of(control))
        yield LiveRig(client, operator, load_specimen(rig.settings.specimen))

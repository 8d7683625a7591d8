"""What becomes of a running rig when a process of it is killed, frozen or stalled, or its disk is full."""

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from acceptance.processes import child_of
from acceptance.safety_cases import FAST_S
from softarm.common.errors import WorkFailedError
from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.experiments.rig import FakeRig, RigSettings, free_endpoint
from softarm.experiments.rig_control import FakeControl
from softarm.experiments.session import connect, wait_ready
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError
from softarm_client.messages import Event, State
from softarm_client.modes import Mode

PRESSURE_MBAR = 200
PRESSURE_PA = 100.0 * PRESSURE_MBAR
WAIT_S = 10.0
RESTART_S = 90.0
"""An estimator is built anew in ten seconds, or in many more where others compute."""
STALLED_S = 3.0
ROOM_BYTES = 300_000
EVENT_NOTES = (
    "Fakes, service and clients are processes of their own, over zenoh. Vented: every valve of the fake "
    "terminal holds zero, as the fakes report on their control port.",
    "A killed client's arm vents when its lease is not renewed (1 s); all else within 0.2 s. Full disk: no "
    "file of the service may grow any more.",
)
CLIENT = """
import sys, time
from softarm_client import Arm

with Arm(sys.argv[1], sys.argv[2], name="mortal") as client:
    with client.states().subscribe(lambda _: None), client.estimates().subscribe(lambda _: None):
        if sys.argv[3] == "lease":
            with client.lease():
                client.arm()
                client.pressures.set([2e4] * 6, lifetime_s=10.0)
                print("ready", flush=True)
                time.sleep(60)
        print("ready", flush=True)
        time.sleep(60)
"""


@dataclass(frozen=True)
class ProcessEvent:
    """What was done to the rig, and what became of the arm.

    Args:
        what: What was done.
        mode: Mode in which it was done.
        vented_s: Seconds until the terminal held zeros; ``None`` when pressure stayed.
        within_s: How soon it must; ``None`` where the arm must carry on.
        said: What the service says of it.
        ended_right: Whether mode and words afterwards are as stated.
        provokes: How often this must end a pressurised mode by a fault.
        faults: Causes of the faults that ended one, from before the event until the arm was idle again.
    """

    what: str
    mode: Mode
    vented_s: float | None
    within_s: float | None
    said: str
    ended_right: bool
    provokes: int = 0
    faults: tuple[str, ...] = ()

    @property
    def spurious(self) -> int:
        """Number of faults that the event did not provoke."""
        return max(len(self.faults) - self.provokes, 0)

    @property
    def right(self) -> bool:
        """Whether all is as stated, and no fault struck that nothing provoked."""
        if self.spurious:
            return False
        if self.within_s is None:
            return self.vented_s is None and self.ended_right
        return self.vented_s is not None and self.vented_s <= self.within_s and self.ended_right

    def row(self) -> dict[str, str | float | bool | None]:
        """Write it as a row of a table."""
        return {
            "what": self.what,
            "mode": str(self.mode),
            "vented_ms": None if self.vented_s is None else 1e3 * self.vented_s,
            "limit_ms": None if self.within_s is None else 1e3 * self.within_s,
            "spurious_faults": self.spurious,
            "as_stated": self.right,
            "said": self.said,
        }


class LiveArm:
    """A running rig and a client of it.

    Args:
        rig: The rig.
        client: The client.
        fakes: Control port of the fakes.
    """

    def __init__(self, rig: FakeRig, client: Arm, fakes: FakeControl) -> None:
        self.rig, self.client, self.fakes = rig, client, fakes
        self.faults: list[str] = []

    def watch(self, event: Event) -> None:
        """Note the cause of every change of mode to FAULTED; a handler of the stream ``event``."""
        if event.kind == "mode" and "-> FAULTED" in event.text:
            self.faults.append(event.text)

    @property
    def pid(self) -> int:
        """The service's process."""
        return self.rig.service.process.pid

    def setpoints(self) -> list[int]:
        """Return what the fake terminal holds for its valves [mbar]."""
        held: list[int] = self.fakes.ask("truth")["setpoints_mbar"]["valves"]
        return held

    def wait_commanded(self) -> None:
        """Wait until the terminal holds the whole pressure; what is measured may be left from before.

        Raises:
            WorkFailedError: It does not come to that.
        """
        deadline = time.monotonic() + WAIT_S
        while max(self.setpoints()) < PRESSURE_MBAR:
            if time.monotonic() > deadline:
                raise WorkFailedError(f"the terminal holds {self.setpoints()} mbar")
            time.sleep(0.01)

    def vented_s(self, since_s: float, within_s: float = 2.0) -> float | None:
        """Wait until the terminal holds zeros and tell how long after an instant that was [s]."""
        while any(self.setpoints()):
            if time.monotonic() - since_s > within_s:
                return None
        return time.monotonic() - since_s

    def wait(self, accept: Callable[[State], bool], within_s: float = WAIT_S) -> State:
        """Wait for a state.

        Raises:
            WorkFailedError: It does not come.
        """
        try:
            return self.client.states().wait_for(accept, within_s)
        except TimeoutError as error:
            state = self.client.state()
            why = state.fault_cause or ", ".join(f.message for f in state.findings)
            raise WorkFailedError(f"the arm is {state.mode} with {state.measured_pa}: {why}") from error

    @contextmanager
    def under_pressure(self, mode: Mode) -> Iterator[None]:
        """Hold pressure in a mode within the block; afterwards IDLE, whatever happened."""
        with self.client.lease():
            self.client.arm()
            asked = [PRESSURE_PA, *[0.0] * 5]
            self.client.pressures.set(asked, lifetime_s=10.0)
            self.wait_commanded()
            if mode is Mode.HOLDING:
                self.client.teach.start()
                self.wait(lambda s: s.teach_pressures_pa is not None)
                self.client.teach.hold(ramp_s=0.2)
            self.wait(lambda s: s.mode == mode and max(p or 0.0 for p in s.measured_pa) > 0.5 * PRESSURE_PA)
            if self.faults:
                raise WorkFailedError(f"a fault that nothing provoked: {self.faults[0]}")
            yield
            self.to_idle()

    def to_idle(self) -> None:
        """Clear what the event provoked and disarm."""
        deadline = time.monotonic() + WAIT_S
        while (state := self.client.state()).mode != Mode.IDLE and time.monotonic() < deadline:
            try:
                (self.client.clear if state.mode == Mode.FAULTED else self.client.disarm)()
            except CommandRefusedError:  # the cause still stands
                time.sleep(0.1)


@contextmanager
def other_client(settings: RigSettings, what: str) -> Iterator[subprocess.Popen[str]]:
    """Run another client: one that holds the ``lease`` with pressure asked, or one that only listens.

    Raises:
        WorkFailedError: It does not get so far.
    """
    words = [sys.executable, "-c", CLIENT, settings.arm, settings.endpoint, what]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            if process.stdout is None or process.stdout.readline() != "ready\n":
                raise WorkFailedError(f"another client ({what}) did not get ready")
            yield process
        finally:
            process.kill()


def strike_processes() -> list[ProcessEvent]:
    """Start a rig and strike its processes, the service itself last."""
    with tempfile.TemporaryDirectory(prefix="softarm-safety-") as folder:
        settings = RigSettings(
            DEMO_SCENARIO, specimen=str(fake_specimen()), endpoint=free_endpoint(), forces_on=("tip",)
        )
        with FakeRig(settings, Path(folder)) as rig, connect(rig) as client:
            wait_ready(client)
            with FakeControl(str(rig.announcement["control"])) as fakes:
                arm = LiveArm(rig, client, fakes)
                with client.events().subscribe(arm.watch):
                    return [struck(arm, strike) for strike in STRIKES]


def struck(arm: LiveArm, strike: Callable[[LiveArm], ProcessEvent]) -> ProcessEvent:
    """Strike once; an arm that does not get where it must, such as by a fault, is a wrong outcome."""
    arm.faults.clear()
    try:
        event = strike(arm)
    except (WorkFailedError, CommandRefusedError) as error:
        arm.to_idle()
        what = strike.__name__.strip("_").replace("_", " ")
        event = ProcessEvent(what, Mode.ARMED, None, None, str(error), False)
    return replace(event, faults=tuple(arm.faults))


def _stalled_subscriber(arm: LiveArm) -> ProcessEvent:
    with other_client(arm.rig.settings, "listen") as process, arm.under_pressure(Mode.ARMED):
        before = arm.client.state()
        process.send_signal(signal.SIGSTOP)
        time.sleep(STALLED_S)
        after, vented = arm.client.state(), not any(arm.setpoints())
        ticked = (after.ticks - before.ticks) / STALLED_S
        said = f"{ticked:.0f} ticks a second, {after.overruns - before.overruns} skipped"
        fine = after.mode == Mode.ARMED and ticked > 0.9 * arm.rig.settings.rate_hz
        return ProcessEvent("a subscriber stalls", Mode.ARMED, 0.0 if vented else None, None, said, fine)


def _full_disk(arm: LiveArm) -> ProcessEvent:
    _, hard = resource.prlimit(arm.pid, resource.RLIMIT_FSIZE)
    with arm.under_pressure(Mode.ARMED):
        arm.client.recordings.start("full")
        resource.prlimit(arm.pid, resource.RLIMIT_FSIZE, (ROOM_BYTES, hard))
        try:
            state = arm.wait(lambda s: any(f.code == "recorder_failed" for f in s.findings))
        finally:
            resource.prlimit(arm.pid, resource.RLIMIT_FSIZE, (hard, hard))
        said = next(f.message for f in state.findings if f.code == "recorder_failed")
        vented = not any(arm.setpoints())
        return ProcessEvent(
            "the disk is full", Mode.ARMED, 0.0 if vented else None, None, said, state.mode == Mode.ARMED
        )


def _frozen_loop(arm: LiveArm) -> ProcessEvent:
    with arm.under_pressure(Mode.ARMED):
        begin = time.monotonic()
        os.kill(arm.pid, signal.SIGSTOP)
        try:
            vented_s = arm.vented_s(begin)
        finally:
            os.kill(arm.pid, signal.SIGCONT)
        state = arm.wait(lambda s: s.mode == Mode.FAULTED)
        return ProcessEvent(
            "the loop freezes", Mode.ARMED, vented_s, FAST_S, state.fault_cause or "", True, provokes=1
        )


def _killed_client(arm: LiveArm) -> ProcessEvent:
    with other_client(arm.rig.settings, "lease") as process:
        arm.wait(lambda s: s.mode == Mode.ARMED)
        arm.wait_commanded()
        begin = time.monotonic()
        process.kill()
        vented_s = arm.vented_s(begin)
        state = arm.wait(lambda s: s.mode == Mode.IDLE)
        return ProcessEvent(
            "the lease's holder is killed", Mode.ARMED, vented_s, 1.0 + FAST_S, state.mode, True
        )


def _killed_estimator(arm: LiveArm) -> ProcessEvent:
    with arm.under_pressure(Mode.HOLDING):
        begin = time.monotonic()
        os.kill(child_of(arm.pid), signal.SIGKILL)
        vented_s = arm.vented_s(begin)
        state = arm.wait(lambda s: s.mode == Mode.FAULTED)
        said = state.fault_cause or ""
        wait_ready(arm.client)
        arm.wait(lambda s: not any(f.code == "estimator_failed" for f in s.findings), RESTART_S)
        return ProcessEvent(
            "the estimator is killed", Mode.HOLDING, vented_s, FAST_S, said, "estimator" in said, provokes=1
        )


def _killed_service(arm: LiveArm) -> ProcessEvent:
    with Arm(arm.rig.settings.arm, arm.rig.settings.endpoint) as client:
        client.acquire()
        client.arm()
        client.pressures.set([PRESSURE_PA] * 6, lifetime_s=10.0)
        arm.wait_commanded()
        begin = time.monotonic()
        os.kill(arm.pid, signal.SIGKILL)
        vented_s = arm.vented_s(begin)
        return ProcessEvent("the service is killed", Mode.ARMED, vented_s, FAST_S, "", True)


STRIKES: tuple[Callable[[LiveArm], ProcessEvent], ...] = (
    _stalled_subscriber,
    _full_disk,
    _frozen_loop,
    _killed_client,
    _killed_estimator,
    _killed_service,
)

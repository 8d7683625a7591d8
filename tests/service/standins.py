"""Dependencies of a control loop without devices, estimator or network: valves that follow set-points."""

import json
import time
from pathlib import Path

import numpy as np
import zenoh

from softarm.daemon.config import ServiceConfig, Setup
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.estimation.messages import EstimationResult, HoldAnswer
from softarm.daemon.estimation.worker import WorkerState
from softarm.drivers.reading import Reading
from softarm.estimator.arm import default_loads
from softarm.estimator.specimen import load_specimen
from softarm_client.messages import Mismatch, Stamp

SPECIMEN = load_specimen("sopra")
LOADS = default_loads(SPECIMEN)
CONFIG = {
    "arm": "page",
    "specimen": "sopra",
    "sensors": [{"kind": "orientation", "section": "tip", "device": "qtm", "channel": "tip", "needed": True}],
    "devices": [{"name": "valves", "kind": "festo_mpa"}],
}
STRAIGHT = (0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0)


def mismatch(sequence: int) -> Mismatch:
    """Return a report that the model fits."""
    return Mismatch(
        stamp=Stamp(sequence=sequence, monotonic_ns=0, unix_ns=0, source="fake"),
        consistent=True,
        since_unix_ns=None,
        where=(),
        normalised_innovation_squared=None,
        recording=None,
        advice="none",
    )


def channel_reading(name: str, values: tuple[float, ...], now_ns: int, source: str) -> ChannelReading:
    """Return a valid reading of a channel that was measured just now."""
    return Reading(name, values, None, now_ns, now_ns, 0, 0, True, source)


def listening_endpoint(session: zenoh.Session) -> str:
    """Return the first endpoint a session really listens on, with the port that 0 became."""
    for reply in session.get(f"@/{session.zid()}/*", timeout=2.0):
        if reply.ok is not None:
            locators = json.loads(reply.ok.payload.to_string()).get("locators", [])
            if locators:
                return str(locators[0])
    raise AssertionError("the session listens on no endpoint")


def setup_in(folder):
    folders = {"state_directory": folder, "recording_directory": folder / "recordings"}
    config = ServiceConfig.model_validate(CONFIG | folders)
    return Setup(Path("-"), "", config, SPECIMEN, ())


class Valves:
    armed = False

    def arm(self):
        self.armed = True

    def vent(self, reason):
        self.armed = False

    def acknowledge(self):
        return False

    def command(self, setpoint, lifetime_s):
        assert self.armed


class Instruments:
    """Valves that do as they are asked and a pose that does not move, fresh at every tick."""

    source, bank = "fake", "valves"

    def __init__(self, readings, clock_ns=time.monotonic_ns):
        self.valves = Valves()
        self.applied = np.zeros(6)
        self.expiries = 0
        self.status = ()
        self._readings = readings
        self._clock_ns = clock_ns

    def valve_alarms(self):
        return (), ()

    async def reconnect(self, name):
        raise KeyError(name)

    def devices(self):
        return self.status

    def troubles(self):
        return {}

    def read(self):
        now = self._clock_ns()
        for name, values in (("valves", (0.0,) * 6), ("qtm/tip", STRAIGHT)):
            self._readings.put(channel_reading(name, values, now, "fake"))


class Estimator:
    """Answers every request at once with one pose."""

    def __init__(self, on_result):
        self.state = WorkerState(running=True, restarts=0, gave_up=False)
        self.requests = []
        self._on_result = on_result

    def submit(self, make):
        request = make()
        if request is not None:
            self.requests.append(request)
            self._on_result(result(request))

    def watch(self):
        pass


def result(request):
    heights = np.array([section.frame_origin_m[2] for section in SPECIMEN.sections])
    return EstimationResult(
        request,
        converged=True,
        model="fem",
        loads=np.array([0.0, 0.0, 0.4, 0.1]),
        load_covariance=1e-3 * np.eye(4),
        positions=np.outer(heights, [0.0, 0.0, 1.0]),
        quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (len(heights), 1)),
        frame_std=np.zeros((len(heights), 6)),
        innovation_squared=1.0,
        degrees_of_freedom=1.0,
        hold=HoldAnswer(np.full(6, 20e3), reachable=True, note="The pose can be reached."),
    )

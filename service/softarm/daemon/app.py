"""The composition root: builds every part of the service, starts and stops them in order."""

import asyncio
import contextlib
import gc
import json
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tomli_w
from numpy.typing import NDArray

from softarm.api.commands import Refused
from softarm.api.page import schemas
from softarm.daemon.config import SensorSettings, Setup
from softarm.daemon.control.channels import Sample
from softarm.daemon.control.controller import Controller
from softarm.daemon.control.guard import Guard, Watched
from softarm.daemon.control.instruments import Instruments, LiveInstruments
from softarm.daemon.control.knowledge import Knowledge
from softarm.daemon.control.mismatch import MismatchTest
from softarm.daemon.control.poses import PoseStore
from softarm.daemon.control.publishing import Kind, Publisher
from softarm.daemon.control.readings import Readings, channel
from softarm.daemon.control.recorder import Recorder, RecorderError
from softarm.daemon.control.replay import ReplayedInstruments
from softarm.daemon.control.streams import RecordedStreams
from softarm.daemon.control.tick import Tick, Ticker
from softarm.daemon.control.verbs import Context, Verbs
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult
from softarm.daemon.estimation.solver import SolverSettings
from softarm.daemon.estimation.worker import NICER, Worker
from softarm.daemon.network.bus import Bus, Call
from softarm.daemon.network.inbox import serve_each
from softarm.daemon.notify import Notifier
from softarm.daemon.safety.checks import ALL_CHECKS
from softarm.daemon.safety.findings import Finding, FindingBook
from softarm.daemon.safety.modes import Event, Mode, Transition
from softarm.daemon.safety.observation import Estimator
from softarm.estimator.arm import default_loads
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import specimen_table

logger = logging.getLogger(__name__)
Floats = NDArray[np.float64]

STATE_RATE_HZ = 20.0
SHAPE_RATE_HZ = 10.0
CONTACT_EVERY_NS = 2_000_000_000


@dataclass(frozen=True)
class Replay:
    """A recording to play instead of the instruments.

    Args:
        recording: What to play.
        speed: Factor on the recorded time.
    """

    recording: Recording
    speed: float

    @property
    def base(self) -> str:
        """Channel of the base's pose, empty when the recording has none."""
        return "base" if "base" in self.recording.frames else ""


class Service:
    """One arm: acquisition, estimation, control, network.

    Args:
        setup: The checked configuration.
        notifier: Speaks to systemd.
        replay: A recording to play instead of the instruments.
    """

    def __init__(self, setup: Setup, notifier: Notifier, replay: Replay | None = None) -> None:
        self._setup = setup
        self._notifier = notifier
        config, specimen = setup.config, setup.specimen
        self._loop = asyncio.get_running_loop()
        self._stopping = asyncio.Event()
        self._recorder = Recorder(config.recording_directory)
        base_body = config.base_body if replay is None else replay.base
        self._readings = Readings(config.sensors, base_body, config.safety, self._record)
        self._instruments = self._make_instruments(replay)
        self._streams = RecordedStreams(
            self._recorder, config.sensors, self._instruments.bank, base_body, len(specimen.chambers)
        )
        self._limits = np.array(specimen.pressure_limits)
        self._controller = Controller(self._instruments.valves, self._limits, config.control, config.safety)
        sections = tuple(section.name for section in specimen.sections)
        self._knowledge = Knowledge(
            sections, default_loads(specimen, config.control.forces_on), self._readings.rest
        )
        self._last_result_ns: int | None = None
        self._submitted_ns = 0
        self._placed_ns = 0
        self._book = FindingBook(ALL_CHECKS)
        self._test = MismatchTest()
        self._worker: Worker[EstimationRequest, EstimationResult] = Worker(
            SolverSettings(specimen, self._estimated_sensors(), config.control),
            self._on_result,
            nicer=NICER if config.control.model == "fem" else 0,
        )
        self._publisher = Publisher(
            self._instruments.source, self._controller, self._knowledge, self._book, config.control.model
        )
        self._guard = self._make_guard()
        self._bus = Bus(config.network, config.arm, self._loop)
        self._verbs = Verbs(
            Context(
                self._controller,
                self._knowledge,
                self._recorder,
                PoseStore(config.state_directory / f"poses-{config.arm}.json"),
                {
                    "service.toml": setup.text.encode(),
                    "specimen.toml": tomli_w.dumps(specimen_table(specimen, setup.path.parent)).encode(),
                },
                lambda mode: self._guard.blocking(mode, time.monotonic_ns()),
            )
        )
        self._shape_every = max(1, round(config.control.rate_hz / SHAPE_RATE_HZ))
        self._ticks = 0

    def _make_instruments(self, replay: Replay | None) -> Instruments:
        if replay is None:
            return LiveInstruments(self._setup, self._readings.take)
        return ReplayedInstruments(
            replay.recording,
            self._setup.config.sensors,
            len(self._setup.specimen.chambers),
            replay.speed,
            self._readings.put,
            self.stop,
        )

    def _make_guard(self) -> Guard:
        return Guard(
            Watched(
                self._instruments,
                self._readings,
                self._controller,
                self._knowledge,
                self._book,
                self._estimator,
                self._recorder.health,
                self._setup.config.safety.valve_deadline_s,
                self._tell_finding,
            )
        )

    def _record(self, name: str, sample: Sample) -> None:
        self._streams.take(name, sample)
        if self._readings.completes(name):
            self._submit(time.monotonic_ns(), after_ticks=0.5)

    def _estimated_sensors(self) -> tuple[SensorSettings, ...]:
        return tuple(sensor for sensor in self._setup.config.sensors if sensor.kind != "gauge")

    async def run(self) -> None:
        """Serve until a signal or ``shut_down``; the arm is vented on every way out."""
        with self._bus:
            self._bus.open(self._slow_values())
            try:
                async with self._worker, asyncio.TaskGroup() as tasks:
                    background = [
                        tasks.create_task(self._instruments.connect()),
                        tasks.create_task(serve_each(self._bus.next_call, self._serve, tasks)),
                    ]
                    await self._control()
                    for task in background:
                        task.cancel()
            finally:
                await self._shut_down()

    def stop(self) -> None:
        """Ask the service to end."""
        self._stopping.set()

    async def _shut_down(self) -> None:
        self._notifier.stopping()
        self._controller.fire(Event.SHUT_DOWN, "the service ends")
        await self._instruments.close()
        if self._recorder.path is not None:
            with contextlib.suppress(RecorderError):
                await asyncio.to_thread(self._recorder.stop)

    async def _serve(self, call: Call) -> None:
        """Carry out one command and answer it; ``stop`` must not wait for a slow disk."""
        before = self._controller.modes.mode
        answer = await self._verbs.answer(call.verb, call.payload)
        if isinstance(answer, Refused):
            logger.warning("%s refused (%s): %s", call.verb, answer.code, answer.message)
        call.answer(answer)
        outcome = answer.model_dump(mode="json")
        self._streams.document("command", outcome)
        if before is not self._controller.modes.mode:
            logger.info("%s: %s -> %s", call.verb, before, self._controller.modes.mode)

    async def _control(self) -> None:
        config = self._setup.config
        interval_s = 1.0 / config.control.rate_hz
        every = max(1, round(config.control.rate_hz / STATE_RATE_HZ))
        gc.collect()
        gc.freeze()
        stopped = asyncio.create_task(self._stopping.wait())
        with Ticker(interval_s) as ticker:
            async for tick in ticker.ticks():
                self._tick(tick, interval_s)
                if tick.index % every == 0 or self._controller.modes.mode is Mode.FAULTED:
                    self._publish_state()
                if stopped.done():
                    return

    def _tick(self, tick: Tick, interval_s: float) -> None:
        now_ns = time.monotonic_ns()
        self._ticks += 1
        self._guard.overran(tick.missed, now_ns)
        if self._controller.modes.mode is Mode.STARTING and not self._worker.state.starting:
            self._follow(self._controller.fire(Event.READY, "the estimator is ready"))
            self._notifier.ready(f"serving {self._setup.config.arm}")
        self._follow(self._guard.advance(now_ns, interval_s * (1 + tick.missed)))
        self._submit(now_ns, after_ticks=1.5)
        self._follow(self._guard.check(now_ns, time.time_ns()))
        self._streams.commanded(self._controller.asked.tolist(), now_ns)
        self._notifier.watchdog()

    def _submit(self, now_ns: int, after_ticks: float) -> None:
        """Ask for an estimate, unless one was asked for less than some ticks ago."""
        if (now_ns - self._submitted_ns) * 1e-9 < after_ticks / self._setup.config.control.rate_hz:
            return
        snapshot = self._readings.snapshot(now_ns)
        valves = self._readings.fresh(self._instruments.bank, now_ns)
        pressures = np.full(len(self._limits), np.nan) if valves is None else np.array(valves.values)
        if not snapshot.used:
            return
        self._submitted_ns = now_ns
        teaching = self._controller.modes.mode in (Mode.TEACH, Mode.HOLDING)
        gravity = np.array(self._setup.specimen.gravity_m_s2)
        self._worker.submit(
            EstimationRequest(
                snapshot.time_s,
                snapshot.newest_arrival_ns,
                snapshot.readings,
                pressures,
                gravity,
                snapshot.used,
                snapshot.lost,
                want_hold=teaching,
                target=None if self._controller.hold is None else self._controller.hold.goal.target,
                want_contact=self._contact_due(),
                tare=self._knowledge.tare,
                want_mesh=self._ticks % self._shape_every == 0 and self._bus.shape_wanted,
            )
        )

    def _contact_due(self) -> bool:
        """Tell whether to place a push now: it takes the estimator a few solves more."""
        rested = time.monotonic_ns() - self._placed_ns > CONTACT_EVERY_NS
        return self._knowledge.contact_since_unix_ns is not None and rested

    def _on_result(self, result: EstimationResult) -> None:
        self._last_result_ns = time.monotonic_ns()
        unix_ns = time.time_ns()
        before = self._knowledge.contact_since_unix_ns
        self._knowledge.take(result, unix_ns)
        estimate = self._publisher.estimate(result)
        self._bus.publish("estimate", estimate)  # before all that can wait
        self._follow_contact(before)
        if result.request.want_contact:
            self._placed_ns = time.monotonic_ns()
        if result.converged:
            self._test = self._test.update(
                result.request.time_s,
                result.innovation_squared,
                result.degrees_of_freedom,
                result.sensor_innovations,
                unix_ns,
            )
        if result.nodes is not None:
            self._bus.publish_shape(result.nodes.astype("<f4").tobytes())
        values = {
            f"force_{load.section}_{axis}_n": load.force_n[index]
            for load in estimate.loads
            for index, axis in enumerate("xyz")
        }
        self._streams.estimated(values, result.request.time_s)

    def _follow(self, transition: Transition | None) -> None:
        if transition is None:
            return
        logger.warning("%s -> %s: %s", transition.before, transition.after, transition.cause)
        self._streams.document(
            "mode",
            {"before": transition.before, "after": transition.after, "cause": transition.cause},
        )
        words = f"{transition.before} -> {transition.after}: {transition.cause}"
        self._happened("mode", self._setup.config.arm, words)
        self._publish_state()

    def _tell_finding(self, finding: Finding, new: bool) -> None:
        """Log and publish a finding that is new or has cleared itself."""
        if new:
            logger.warning("%s: %s; %s", finding.where, finding.message, finding.hint)
        else:
            logger.info("%s: no longer: %s", finding.where, finding.message)
        self._happened("finding" if new else "finding_cleared", finding.where, finding.message)

    def _happened(self, kind: Kind, where: str, text: str) -> None:
        self._streams.document("event", {"kind": kind, "where": where, "text": text})
        self._bus.publish("event", self._publisher.occurrence(kind, where, text))

    def _follow_contact(self, before: int | None) -> None:
        """Tell that a contact began or ended."""
        since = self._knowledge.contact_since_unix_ns
        if (before is None) is (since is None):
            return
        kind: Kind = "contact_end" if since is None else "contact_begin"
        words = "the external force is back in the noise" if since is None else "an external force stands out"
        self._happened(kind, self._setup.config.arm, words)

    def _estimator(self, now_ns: int) -> Estimator:
        """Picture the estimator's process for the guard."""
        age_s = None if self._last_result_ns is None else (now_ns - self._last_result_ns) * 1e-9
        deadline_s = self._setup.config.safety.estimator_deadline_s
        result = self._knowledge.result
        off = None if result is None or result.rod_off_rad is None else float(np.degrees(result.rod_off_rad))
        return Estimator(self._worker.state.running, age_s, deadline_s, self._knowledge.failures, off)

    def _publish_state(self) -> None:
        now_ns = time.monotonic_ns()
        chambers = len(self._limits)
        fresh = self._readings.fresh(self._instruments.bank, now_ns)
        measured = np.full(chambers, np.nan) if fresh is None else np.array(fresh.values)
        ages = {
            f"{sensor.kind}_{sensor.section}": self._readings.age_s(channel(sensor), now_ns)
            for sensor in self._setup.config.sensors
        } | {self._instruments.bank: self._readings.age_s(self._instruments.bank, now_ns)}
        recording = None if self._recorder.path is None else str(self._recorder.path)
        gauges = self._gauges(now_ns)
        self._bus.publish(
            "state",
            self._publisher.state(
                self._instruments.applied,
                measured,
                gauges,
                ages,
                self._ticks,
                self._guard.overruns,
                recording,
            ),
        )
        self._bus.publish("mismatch", self._publisher.mismatch(self._test, recording))

    def _gauges(self, now_ns: int) -> dict[str, float | None]:
        found = {}
        for sensor in self._setup.config.sensors:
            if sensor.kind == "gauge":
                sample = self._readings.fresh(channel(sensor), now_ns)
                found[sensor.section] = None if sample is None else sample.values[0]
        return found

    def _slow_values(self) -> dict[str, Callable[[], bytes]]:
        config, specimen = self._setup.config, self._setup.specimen
        return {
            "config": lambda: config.model_dump_json().encode(),
            "specimen": lambda: specimen.model_dump_json(by_alias=True).encode(),
            "schema": lambda: json.dumps(schemas()).encode(),
        }

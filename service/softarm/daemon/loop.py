"""The control loop: each step renews the set-point, starts an estimate, judges health and publishes."""

from collections.abc import Mapping, Sequence

import numpy as np
import tomli_w

from softarm.daemon.config import Setup
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.control.command_handler import CommandContext, CommandHandler
from softarm.daemon.control.controller import Controller
from softarm.daemon.control.deadlines import deadlines_s
from softarm.daemon.control.dependencies import LoopDependencies
from softarm.daemon.control.estimates import Estimates
from softarm.daemon.control.estimator_state import EstimatorState
from softarm.daemon.control.lateness import Lateness
from softarm.daemon.control.poses import PoseStore
from softarm.daemon.control.publishing import Publisher, StateInputs
from softarm.daemon.control.readings import Readings, channel
from softarm.daemon.control.recorder import Recorder
from softarm.daemon.control.recording_header import recording_header
from softarm.daemon.control.reporting import Reporter
from softarm.daemon.control.safety_monitor import SafetyInputs, SafetyMonitor
from softarm.daemon.control.streams import RecordedStreams
from softarm.daemon.control.tick import Tick
from softarm.daemon.safety.checks import ALL_CHECKS
from softarm.daemon.safety.diagnostics import HealthMonitor
from softarm.daemon.safety.modes import Mode, Transition, Trigger
from softarm.estimator.arm import default_loads
from softarm.estimator.specimen import specimen_table
from softarm.recordings.mcap_writer import Start
from softarm_client.commands import Applied, Refused

STATE_EVERY_NS = 50_000_000


class ControlLoop:
    """The control side of one arm; the daemon, the safety benchmark and tests run this same loop.

    Building it starts nothing. Who owns it calls ``step`` at each tick, ``answer`` for each command, and
    ``shut_down`` on every way out.

    Args:
        setup: The checked configuration.
        dependencies: Instruments, estimator, network and clocks.
    """

    def __init__(self, setup: Setup, dependencies: LoopDependencies) -> None:
        config, specimen = setup.config, setup.specimen
        self._setup = setup
        self._dependencies = dependencies
        self._clocks = dependencies.clocks
        self.recorder = Recorder(
            config.recording_directory,
            free_bytes=lambda: dependencies.host().free_bytes,
            header=recording_header(setup),
            clocks=lambda: Start(self._clocks.monotonic_ns(), self._clocks.unix_ns()),
        )
        self._lateness = Lateness()
        self.readings = Readings(
            config.sensors,
            dependencies.base_body,
            config.safety,
            self._on_reading,
            self._on_packet,
            deadlines_s(setup),
        )
        self.instruments = dependencies.instruments(self.readings)
        self._streams = RecordedStreams(
            self.recorder,
            config.sensors,
            self.instruments.bank,
            dependencies.base_body,
            len(specimen.chambers),
            self._clocks.monotonic_ns,
        )
        limits = np.array(setup.pressure_limits)
        self.controller = Controller(
            self.instruments.valves, limits, config.control, config.safety, self._on_transition
        )
        self.estimator_state = EstimatorState(
            tuple(section.name for section in specimen.sections),
            default_loads(specimen, config.control.forces_on),
            self.readings.rest,
            self._clocks.monotonic_ns,
        )
        health = HealthMonitor(ALL_CHECKS)
        publisher = Publisher(
            config.specimen,
            self.instruments.source,
            self.controller,
            self.estimator_state,
            health,
            self._clocks.monotonic_ns,
            self._clocks.unix_ns,
        )
        self._reporter = Reporter(config.arm, publisher, dependencies.sink, self._streams)
        self.estimates = Estimates(
            setup,
            dependencies,
            self.readings,
            self.instruments,
            self.controller,
            self.estimator_state,
            self._reporter,
        )
        self.safety = SafetyMonitor(
            SafetyInputs(
                self.instruments,
                self.readings,
                self.controller,
                self.estimator_state,
                health,
                self.estimates.observe,
                self.recorder.health,
                config.safety.valve_deadline_s,
                self._reporter.finding,
                self._lateness.busy,
            )
        )
        self._commands = self._make_commands()
        self._ticks = 0
        self._published_ns = 0
        self._ready = False

    def _make_commands(self) -> CommandHandler:
        config, clocks = self._setup.config, self._clocks
        return CommandHandler(
            CommandContext(
                self.controller,
                self.estimator_state,
                self.recorder,
                PoseStore(config.state_directory / f"poses-{config.arm}.json"),
                _attachments(self._setup),
                self.instruments.reconnect,
                lambda mode: self.safety.blocking(mode, clocks.monotonic_ns()),
                clocks.monotonic_ns,
                clocks.unix_ns,
            )
        )

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self.controller.modes.mode

    def step(self, tick: Tick) -> None:
        """Run one pass.

        Args:
            tick: When the pass was due, how late it came, and how many were skipped before it.
        """
        now_ns = tick.deadline_ns + tick.drift_ns  # when the step began; all of it is judged at this time
        self._ticks += 1
        self.safety.overran(tick.missed, now_ns)
        self._lateness.add(now_ns, tick.late_ns)
        self._lateness.starved_percent = self._dependencies.host().starved_percent
        self.estimates.process.watch()
        self._announce_ready()
        # The set-point first: nothing below may delay what the valves wait for.
        self.safety.advance(now_ns, (1 + tick.missed) / self._setup.config.control.rate_hz)
        self.estimates.on_tick(now_ns)
        self.safety.check(now_ns, self._clocks.unix_ns())
        self._streams.commanded(self.controller.setpoint.tolist(), now_ns)
        if now_ns - self._published_ns >= STATE_EVERY_NS:
            self._publish_state(now_ns)

    def _announce_ready(self) -> None:
        """Report once that the estimator has started, whatever mode commands have led to meanwhile."""
        if self._ready or self.estimates.process.state.starting:
            return
        self._ready = True
        if self.controller.modes.allows(Trigger.READY):
            gave_up = self.estimates.process.state.gave_up
            cause = "the estimator cannot be built: see the log" if gave_up else "the estimator is ready"
            self.controller.fire(Trigger.READY, cause)
        self._dependencies.ready()

    async def answer(self, verb: str, payload: bytes) -> Applied | Refused:
        """Carry out one command and record its answer."""
        answer = await self._commands.answer(verb, payload)
        self._reporter.command(answer.model_dump(mode="json"))
        return answer

    def stop(self, payload: bytes) -> Applied:
        """Vent and latch a fault at once, whatever the payload holds, and record the answer."""
        answer = self._commands.stop(payload)
        self._reporter.command(answer.model_dump(mode="json"))
        return answer

    def record_surface(self, triangles: Sequence[tuple[int, int, int]]) -> None:
        """Record the arm's surface from now on.

        Args:
            triangles: Nodes of each triangle, as the stream ``shape`` numbers them.
        """
        self._streams.triangles = triangles

    def shut_down(self) -> None:
        """Vent the arm for good."""
        self.controller.fire(Trigger.SHUT_DOWN, "the service ends")

    def _on_reading(self, reading: ChannelReading) -> None:
        self._streams.record_reading(
            reading
        )  # the streams need the instruments, and these the readings: built later

    def _on_packet(self) -> None:
        """Start an estimate as soon as a packet of the leading device is complete."""
        self.estimates.on_packet(self._clocks.monotonic_ns())

    def _on_transition(self, transition: Transition) -> None:
        self.estimator_state.wake()  # a command that waits for a hold must see that there will be none
        self._reporter.transition(transition)
        self._publish_state(self._clocks.monotonic_ns())

    def _publish_state(self, now_ns: int) -> None:
        self._published_ns = now_ns
        self._reporter.state(self._state_inputs(now_ns), self.estimates.test)

    def _state_inputs(self, now_ns: int) -> StateInputs:
        bank, sensors = self.instruments.bank, self._setup.config.sensors
        measured = self.readings.fresh(bank, now_ns)
        ages = {
            f"{sensor.kind}_{sensor.section}": self.readings.age_s(channel(sensor), now_ns)
            for sensor in sensors
        }
        recording = self.recorder.path
        return StateInputs(
            applied=self.instruments.applied,
            measured=None if measured is None else np.array(measured.value),
            gauges_n=self._gauges(now_ns),
            ages_s=ages | {bank: self.readings.age_s(bank, now_ns)},
            ticks=self._ticks,
            overruns=self.safety.overruns,
            drift=self._lateness.drift,
            recording=None if recording is None else str(recording),
        )

    def _gauges(self, now_ns: int) -> dict[str, float | None]:
        samples = {
            sensor.section: self.readings.fresh(channel(sensor), now_ns)
            for sensor in self._setup.config.sensors
            if sensor.kind == "gauge"
        }
        return {name: None if sample is None else sample.value[0] for name, sample in samples.items()}


def _attachments(setup: Setup) -> Mapping[str, bytes]:
    """Return the files that every recording keeps."""
    specimen = tomli_w.dumps(specimen_table(setup.specimen, setup.path.parent))
    return {"service.toml": setup.text.encode(), "specimen.toml": specimen.encode()}

"""One connection to a valve terminal: a block read and a block write per pass, each answer judged."""

import asyncio

from softarm.drivers.clock import NANOSECONDS, Clock, PollTick, PollTicker
from softarm.drivers.errors import ConfigurationError, ConnectionLost, DeviceError, ProtocolError
from softarm.drivers.health import Health
from softarm.drivers.stream import ReadingStream
from softarm.drivers.valves.alarms import ValveAlarms
from softarm.drivers.valves.config import ValveConfig
from softarm.drivers.valves.echo import EchoMonitor, Verdict
from softarm.drivers.valves.identify import identify_terminal, prepare_terminal, report_watchdog
from softarm.drivers.valves.link import ModbusExceptionError, NoAnswer
from softarm.drivers.valves.outputs import Outputs
from softarm.drivers.valves.pressures import BankReading, Pressures
from softarm.drivers.valves.registers import OUTPUTS, VtemLayout
from softarm.drivers.valves.terminal import Terminal, TimedInputs
from softarm.drivers.valves.tracking import TrackingMonitor
from softarm.drivers.valves.vtem import deactivate
from softarm.drivers.valves.watchdog import WatchdogState

CLOSE_ATTEMPTS = 3
QUIET_NS = NANOSECONDS // 4
"""Silence after which a terminal without a watchdog is read before it is written [ns]."""
CALM_NS = NANOSECONDS
"""The echo must be ours for so long before its alarms clear: another master may write now and then [ns]."""


class BankSession:
    """Runs the passes of one connection.

    Args:
        config: How to talk to the terminal.
        terminal: The terminal, connected.
        outputs: What to write.
        stream: Where the readings go.
        health: Counters and alarms.
        clock: Host monotonic time.
        observe: Write nothing at all.
    """

    def __init__(
        self,
        config: ValveConfig,
        terminal: Terminal,
        outputs: Outputs,
        stream: ReadingStream[BankReading],
        health: Health,
        clock: Clock,
        *,
        observe: bool,
    ) -> None:
        self._config = config
        self._device = config.name
        self._terminal = terminal
        self._outputs = outputs
        self._stream = stream
        self._health = health
        self._clock = clock
        self._observe = observe
        self._period_s = 1.0 / config.rate_hz
        valve_of = outputs.chambers.valve_of
        self._echo = EchoMonitor(round(config.echo_lag_s * NANOSECONDS))
        self._tracking = TrackingMonitor(
            len(valve_of),
            round(config.reach_s * NANOSECONDS),
            config.tracking_tolerance_pa,
            round(config.tracking_confirm_s * NANOSECONDS),
        )
        self._alarms = ValveAlarms(health.alarms, valve_of, config.reach_s)
        self._watchdog = WatchdogState(None, "not probed")
        self._zeros = (0,) * terminal.layout.valves
        self._applied: Pressures = (0.0,) * len(valve_of)
        self._setpoint: Pressures | None = None
        self._wrote = False
        self._unknown = False
        self._misses = 0
        self._fed_ns = self._odd_ns = clock() - CALM_NS
        self._taken_ns = clock()
        self._verdict = Verdict.OURS

    async def identify(self) -> None:
        """Look at the terminal; unless only observing, vent it and set its watchdog.

        Raises:
            ConnectionLost: The terminal is busy.
            ConfigurationError: It is not what the configuration states.
        """
        try:
            await self._prepare()
        except ModbusExceptionError as refusal:
            if not refusal.busy:
                raise
            raise ConnectionLost(self._device, refusal.what, "wait, or restart the terminal") from refusal

    async def _prepare(self) -> None:
        standing = await identify_terminal(self._terminal, self._device, self._health)
        if self._observe:
            self._watchdog = await report_watchdog(self._terminal, self._health)
            return
        self._wrote = True  # before the first write: one that fails half-way must be vented by `close` too
        if standing is not None:
            # What an earlier host left may still show in the first echoes; it is no foreign writer.
            self._echo.attempted(standing, self._clock())
        self._echo.attempted(self._zeros, self._clock())
        self._watchdog = await prepare_terminal(
            self._terminal, self._device, self._health, self._clock, self._config.watchdog_ms
        )

    async def stream(self) -> None:
        """Run passes at a fixed rate until the connection is lost."""
        ticker = PollTicker(round(self._period_s * NANOSECONDS), self._clock)
        self._fed_ns = self._taken_ns = self._clock()
        while True:
            tick = await ticker.wait()
            self._health.drift.add(tick.drift_ns)
            self._health.overruns += tick.skipped
            await self.run_pass(tick)

    async def close(self) -> None:
        """Vent whatever was written to, and release the connection."""
        try:
            if self._wrote and self._terminal.link.connected:
                await self._leave_vented()
        finally:
            self._terminal.link.close()

    async def run_pass(self, tick: PollTick) -> None:
        """Run one pass: read, write, check the echo, and publish what was measured."""
        self._verdict = Verdict.OURS
        try:
            sample = await self._read() if self._must_read(tick) else None
            if not self._observe:
                # The host stalled over that read: a write now would hide outputs that the watchdog cleared.
                if sample is not None and self._silent:
                    sample = await self._read()
                sample = await self._write() or sample
        except ModbusExceptionError as refusal:
            if not refusal.busy:
                raise ConfigurationError(self._device, refusal.what, refusal.cure) from refusal
            self._health.events["terminal busy"] += 1
            self._check_taken(refusal)
            return  # an answer all the same: no miss
        except (NoAnswer, ProtocolError) as error:
            self._miss(error)
            return
        self._misses = 0
        if sample is not None:
            self._publish(sample)

    def _must_read(self, tick: PollTick) -> bool:
        """Return whether to read before writing, so that the echo is not yet changed by this pass."""
        if not self._terminal.exchanges or self._unknown or tick.index % self._config.verify_every == 0:
            return True
        return self._silent

    @property
    def _silent(self) -> bool:
        """Whether the last request was so long ago that the terminal's watchdog may have fired since.

        A request feeds it when it is sent: a host may stall while the answer is on its way.
        """
        # Half the time-out: a pass that begins just before the watchdog fires may end after it.
        quiet_ns = self._watchdog.milliseconds * 500_000 if self._watchdog.milliseconds else QUIET_NS
        return self._clock() - self._fed_ns > quiet_ns

    async def _read(self) -> TimedInputs:
        requested_ns = self._clock()
        sample = await self._terminal.read()
        self._fed_ns = requested_ns
        self._judge(sample)
        self._unknown = False
        self._alarms.outputs(unknown=False)
        return sample

    async def _write(self) -> TimedInputs | None:
        plan = self._outputs.plan(self._period_s)
        self._alarms.expired(plan.expired, plan.setpoint is not None or not self._outputs.armed)
        self._health.events["set-point expired"] += plan.expired
        self._echo.attempted(plan.counts, self._clock())
        # Until the answer comes it is unknown whether the terminal accepted the set-points.
        self._unknown = True
        requested_ns = self._clock()
        try:
            sample = await self._terminal.write(plan.counts, plan.acknowledge)
        except ModbusExceptionError:
            self._unknown = False  # a refusal is an answer: they are not in the terminal
            self._echo.refused()
            raise
        self._unknown = False
        self._fed_ns = self._taken_ns = requested_ns
        self._echo.answered(self._clock() if sample is None else sample.arrival_ns)
        self._applied, self._setpoint = plan.applied, plan.setpoint
        if sample is not None:
            self._judge(sample)
        return sample

    def _judge(self, sample: TimedInputs) -> None:
        if self._observe or sample.inputs.echo is None:
            return
        verdict = self._echo.judge(sample.inputs.echo, sample.arrival_ns)
        if verdict is Verdict.OURS:
            if sample.arrival_ns - self._odd_ns >= CALM_NS:
                self._alarms.echo_is_ours()
            return
        self._odd_ns = sample.arrival_ns
        self._verdict = verdict
        # Both vent and disarm: nothing may move again before somebody has seen the alarm.
        if verdict is Verdict.ZEROED:
            new, reason = self._alarms.watchdog_fired(), "the terminal cleared its outputs"
        else:
            new, reason = self._alarms.foreign_writer(), "another master wrote to the valves"
        self._health.events[reason] += new
        self._outputs.vent(reason)

    def _check_taken(self, refusal: ModbusExceptionError) -> None:
        """End the connection to a terminal that stays busy: only its watchdog can vent then.

        Raises:
            ConnectionLost: It has accepted no set-point for the time of a watchdog.
        """
        limit = self._config.watchdog_ms
        if not self._observe and self._clock() - self._taken_ns > limit * NANOSECONDS // 1000:
            what = f"accepts no set-point: {refusal.what}"
            raise ConnectionLost(self._device, what, "restart the terminal", limit=limit, unit="ms")

    def _miss(self, error: DeviceError) -> None:
        self._health.last_error = error
        self._misses += 1
        self._alarms.outputs(self._unknown)
        if self._misses >= self._config.lost_after_misses:
            what = f"gave no usable answer to {self._misses} requests in a row; the last error: {error.what}"
            raise ConnectionLost(self._device, what, error.cure) from error

    def _publish(self, sample: TimedInputs) -> None:
        chambers = self._outputs.chambers
        inputs = sample.inputs
        readback = chambers.to_pressures(inputs.actual)
        diagnosis = chambers.pick(inputs.diagnosis)
        self._alarms.diagnosis(diagnosis)
        if not self._observe:
            deviations = self._tracking.update(self._applied, readback, sample.arrival_ns)
            self._alarms.tracking(deviations, self._applied)
        ours = self._verdict is Verdict.OURS
        echo = None if inputs.echo is None else chambers.to_pressures(inputs.echo)
        self._stream.publish(
            BankReading(self._setpoint, self._applied, echo, readback, diagnosis, self._outputs.armed),
            host_ns=sample.arrival_ns,
            measured_ns=sample.measured_ns,
            valid=ours,
            flags=() if ours else (self._verdict.value,),
        )

    async def _leave_vented(self) -> None:
        """Write zeros until the terminal holds them."""
        terminal = self._terminal
        for _ in range(CLOSE_ATTEMPTS):
            try:
                await terminal.link.write(OUTPUTS, terminal.layout.encode(self._zeros))
                echo = (await terminal.read()).inputs.echo
            except (NoAnswer, ProtocolError, ModbusExceptionError):
                continue
            if echo is None or not any(echo):
                break
            # The echo follows a write by some passes of the terminal's own cycle.
            await asyncio.sleep(self._config.echo_lag_s / CLOSE_ATTEMPTS)
        else:
            what = f"could not be vented (watchdog: {self._watchdog.fact})"
            raise ConnectionLost(self._device, what, "shut off the supply")
        if isinstance(terminal.layout, VtemLayout):
            await deactivate(terminal.link, terminal.layout, self._device, self._clock)

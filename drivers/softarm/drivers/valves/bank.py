"""The valve bank as a device: connect, arm, set pressures, vent, close."""

from collections.abc import Awaitable, Callable, Sequence
from random import Random
from typing import Annotated, Literal

from pydantic import Field

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.device import Device
from softarm.drivers.errors import InterlockError
from softarm.drivers.reading import Reading, Sink, ignore
from softarm.drivers.stream import ReadingStream
from softarm.drivers.supervisor import ALIVE, ConnectionState, Timing
from softarm.drivers.valves.alarms import BLOCKING, reports_fault
from softarm.drivers.valves.config import ValveConfig
from softarm.drivers.valves.limits import PressureLimits
from softarm.drivers.valves.link import RegisterLink
from softarm.drivers.valves.modbus import ModbusTcpLink
from softarm.drivers.valves.outputs import Outputs
from softarm.drivers.valves.pressures import BankReading, ChamberMap
from softarm.drivers.valves.registers import MPA_VALVES, VTEM_SLOTS, MpaLayout, VtemLayout
from softarm.drivers.valves.session import BankSession
from softarm.drivers.valves.terminal import Terminal
from softarm.drivers.valves.vtem import ACKNOWLEDGE_S


class ValveBank(Device):
    """Proportional valves that fill the chambers of an arm.

    A set-point lives for a stated time; without renewal the chambers vent, and the bank stays armed: the next
    set-point fills them again from zero, at the rate of the slew limit. A caller that must not
    refill them, as the service that holds a pose, watches the event ``set-point expired`` and disarms. The
    chambers also vent when the terminal cleared its outputs, when another master writes, when the connection
    breaks, and on `close`.
    After each of these only `arm` makes the bank accept set-points again: nothing moves by itself.

    Args:
        config: Its settings.
        sink: Receives each reading.
        clock: Host monotonic time.
        observe: Write nothing at all.
        open_link: Opens the connection to the registers; over Modbus TCP when left out.
        random: Source of the jitter between attempts.
    """

    def __init__(
        self,
        config: ValveConfig,
        sink: Sink = ignore,
        clock: Clock = monotonic,
        *,
        observe: bool = False,
        open_link: Callable[[], Awaitable[RegisterLink]] | None = None,
        random: Random | None = None,
    ) -> None:
        self.layout = config.layout()
        slow = isinstance(self.layout, VtemLayout)
        timing = Timing(
            stale_after_s=config.stale_after_s,
            lost_after_s=config.lost_after_s,
            identify_s=25.0 if slow else 3.0,  # the slots of a VTEM need up to 20 s to start regulating
            close_s=15.0 if slow else 1.0,  # and 11 s to exhaust and stop
        )
        super().__init__(config.name, config.source, timing=timing, clock=clock, random=random)
        self.limits = PressureLimits(config.maximum, config.slew_pa_per_s, config.max_lifetime_s)
        self.chambers = ChamberMap(config.chambers, self.layout.valves, config.pascal_per_count)
        self.stream: ReadingStream[BankReading] = self.reading_stream(sink)
        self._config = config
        self._observe = observe
        self._outputs = Outputs(config.name, self.limits, self.chambers, clock)
        self._open_link = open_link or self._open_modbus

    @property
    def armed(self) -> bool:
        """Whether set-points are accepted."""
        return self._outputs.armed

    @property
    def latest(self) -> Reading[BankReading] | None:
        """The latest reading, however old."""
        return self.stream.latest

    def arm(self) -> None:
        """Accept set-points; the chambers stay vented until one comes.

        Raises:
            InterlockError: The bank is not connected, only observes, or an alarm stands that forbids it.
        """
        if self._observe:
            raise InterlockError(self.name, "is open for observation only", "open it for control")
        if self.state not in ALIVE:
            error = self.failure
            what = "is not connected" if error is None else f"is not connected: {error.what}"
            cure = "wait until it answers" if error is None else error.cure
            raise InterlockError(self.name, what, cure)
        for alarm in self.health.alarms.active:
            if alarm.key in BLOCKING:
                raise InterlockError(self.name, f"cannot be armed: {alarm.what}", alarm.cure)
        self._outputs.arm()

    def vent(self, reason: str = "asked for") -> None:
        """Vent every chamber with the next pass and accept no set-point until `arm`.

        Args:
            reason: Why, for whoever tries to command it.
        """
        self._outputs.vent(reason)

    def acknowledge(self) -> bool:
        """Clear the errors that the slots of the terminal keep; nothing else ever does.

        Returns:
            Whether there are any; the valves regulate again after a second or two. A terminal that keeps
            no errors has nothing to acknowledge.

        Raises:
            InterlockError: The bank is armed.
        """
        if not (self.layout.keeps_errors and reports_fault(self.health.alarms)):
            return False
        self._outputs.acknowledge(ACKNOWLEDGE_S)
        return True

    def command(self, setpoint: Sequence[float], lifetime_s: float) -> None:
        """Put a set-point in force from the next pass on, without waiting for it.

        Args:
            setpoint: Gauge pressure of each chamber [Pa].
            lifetime_s: After so long the chambers vent unless it is renewed [s].

        Raises:
            InterlockError: The bank is not armed.
            LimitError: A pressure or the lifetime is out of range; nothing changes.
        """
        self._outputs.command(setpoint, lifetime_s)

    async def open(self) -> BankSession:
        """Open the connection to the terminal."""
        return self.session(await self._open_link())

    def session(self, link: RegisterLink) -> BankSession:
        """Return the session on an open connection."""
        return BankSession(
            self._config,
            Terminal(link, self.layout, self.clock),
            self._outputs,
            self.stream,
            self.health,
            self.clock,
            observe=self._observe,
        )

    async def _open_modbus(self) -> RegisterLink:
        config = self._config
        link = ModbusTcpLink(
            self.name,
            config.host,
            config.port,
            unit=config.unit,
            timeout_s=config.response_timeout_s,
            open_s=self.timing.open_s,
            health=self.health,
            clock=self.clock,
        )
        await link.open()
        return link

    def on_state(self, before: ConnectionState, after: ConnectionState) -> None:
        """Drop the set-point with the connection: coming back brings data, never motion."""
        if before in ALIVE and after not in ALIVE:
            self._outputs.vent(
                "the connection was lost" if after is ConnectionState.FAULT else "it was closed"
            )
            self.stream.start_epoch("connection ended")


class MpaConfig(ValveConfig):
    """MPA proportional valves on a CPX terminal."""

    kind: Literal["festo_mpa"]
    valves: Annotated[int, Field(ge=1, le=41)] = MPA_VALVES

    def layout(self) -> MpaLayout:
        """Return where the terminal keeps its valves."""
        return MpaLayout(self.valves)

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> ValveBank:
        """Build the bank; no I/O before its `connect`."""
        return ValveBank(self, sink, clock, observe=observe)


class VtemConfig(ValveConfig):
    """A VTEM Motion Terminal; valve ``2 * slot`` is A of a slot, the next one B.

    Attributes:
        slots: How many slots are fitted.
    """

    kind: Literal["festo_vtem"]
    slots: Annotated[int, Field(ge=1, le=VTEM_SLOTS)] = VTEM_SLOTS

    def layout(self) -> VtemLayout:
        """Return where the terminal keeps its valves."""
        return VtemLayout(self.slots)

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> ValveBank:
        """Build the bank; no I/O before its `connect`."""
        return ValveBank(self, sink, clock, observe=observe)

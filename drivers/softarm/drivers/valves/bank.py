"""The valve bank as a device: connect, arm, set pressures, vent, close."""

from collections.abc import Awaitable, Callable, Sequence
from random import Random

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.device import Device
from softarm.drivers.errors import InterlockError
from softarm.drivers.reading import Reading, Sink, ignore
from softarm.drivers.stream import ReadingStream
from softarm.drivers.supervisor import ALIVE, ConnectionState, Timing
from softarm.drivers.valves.alarms import BLOCKING, reports_fault
from softarm.drivers.valves.limits import PressureLimits
from softarm.drivers.valves.link import RegisterLink
from softarm.drivers.valves.outputs import Outputs
from softarm.drivers.valves.pressures import BankReading, ChamberMap
from softarm.drivers.valves.registers import RegisterLayout
from softarm.drivers.valves.session import BankSession, CycleSettings
from softarm.drivers.valves.terminal import Terminal
from softarm.drivers.valves.vtem import ACKNOWLEDGE_S

OpenLink = Callable[["ValveBank"], Awaitable[RegisterLink]]


class ValveBank(Device):
    """Proportional valves that fill the chambers of an arm.

    A set-point lives for a stated time; without renewal the chambers vent, and the bank stays armed: the next
    set-point fills them again from zero, at the rate of the slew limit. A caller that must not
    refill them, as the service that holds a pose, watches the event ``set-point expired`` and disarms. The
    chambers also vent when the terminal cleared its outputs, when another master writes, when the connection
    breaks, and on `close`.
    After each of these only `arm` makes the bank accept set-points again: nothing moves by itself.

    Args:
        name: Name of the device in readings, errors and logs.
        source: Where its readings come from.
        open_link: Opens the connection to the registers.
        layout: Where the terminal keeps its valves.
        chambers: Which valve feeds which chamber.
        limits: Limits of the chambers.
        settings: How to talk to the terminal.
        timing: Deadlines of the connection.
        sink: Takes each reading.
        clock: Host monotonic time.
        random: Source of the jitter between attempts.
    """

    def __init__(
        self,
        name: str,
        source: str,
        open_link: OpenLink,
        *,
        layout: RegisterLayout,
        chambers: ChamberMap,
        limits: PressureLimits,
        settings: CycleSettings,
        timing: Timing,
        sink: Sink = ignore,
        clock: Clock = monotonic,
        random: Random | None = None,
    ) -> None:
        super().__init__(name, source, timing=timing, clock=clock, random=random)
        self.limits = limits
        self.chambers = chambers
        self.stream: ReadingStream[BankReading] = self.reading_stream(sink)
        self._outputs = Outputs(name, limits, chambers, clock)
        self._open_link = open_link
        self.layout = layout
        self.settings = settings

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
        if self.settings.observe:
            raise InterlockError(self.name, "is open for observation only", "open it for control")
        if self.state not in ALIVE:
            error = self.failure
            what = "is not connected" if error is None else f"is not connected: {error.what}"
            cure = "wait until it answers" if error is None else error.cure
            raise InterlockError(self.name, what, cure)
        for alarm in self.health.alarms.standing:
            if alarm.key in BLOCKING:
                raise InterlockError(self.name, f"cannot be armed: {alarm.what}", alarm.cure)
        self._outputs.arm()

    def vent(self, reason: str = "asked for") -> None:
        """Vent every chamber with the next pass and take no set-point until `arm`.

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
        return self.session(await self._open_link(self))

    def session(self, link: RegisterLink) -> BankSession:
        """Return the session on an open connection."""
        return BankSession(
            self.name,
            Terminal(link, self.layout, self.clock),
            self._outputs,
            self.stream,
            self.health,
            self.settings,
            self.clock,
        )

    def on_state(self, before: ConnectionState, after: ConnectionState) -> None:
        """Drop the set-point with the connection: coming back brings data, never motion."""
        if before in ALIVE and after not in ALIVE:
            self._outputs.vent(
                "the connection was lost" if after is ConnectionState.FAULT else "it was closed"
            )
            self.stream.start_epoch("connection ended")

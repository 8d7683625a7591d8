"""The terminal's own watchdog: it vents when the host falls silent. Probed, never taken for granted."""

from dataclasses import dataclass

from softarm.drivers.errors import ConfigurationError
from softarm.drivers.valves.link import ModbusExceptionError, RegisterLink
from softarm.drivers.valves.registers import WATCHDOG


@dataclass(frozen=True, slots=True)
class WatchdogState:
    """The time-out of the terminal.

    Attributes:
        milliseconds: Time-out in force; 0 never fires; None where the terminal has no such register.
        fact: The same in words.
    """

    milliseconds: int | None
    fact: str


async def read_watchdog(link: RegisterLink) -> WatchdogState:
    """Read the time-out; a terminal without the register has none."""
    try:
        (milliseconds,) = await link.read(WATCHDOG, 1)
    except ModbusExceptionError as refusal:
        # The refusal of a busy terminal does not concern the register: it ends the attempt.
        if refusal.busy:
            raise
        return WatchdogState(None, f"host side only: the terminal has no register {WATCHDOG}")
    return WatchdogState(milliseconds, _fact(milliseconds))


async def set_watchdog(link: RegisterLink, device: str, wanted_ms: int) -> WatchdogState:
    """Set the time-out and read it back.

    Args:
        link: Registers of the terminal.
        device: The device, for errors.
        wanted_ms: Time-out [ms].

    Returns:
        What is in force: no longer than wanted, or no watchdog at all.

    Raises:
        ConfigurationError: The terminal keeps a longer time-out than wanted.
    """
    before = await read_watchdog(link)
    if before.milliseconds is None:
        return before
    try:
        if before.milliseconds != wanted_ms:
            await link.write_one(WATCHDOG, wanted_ms)
    except ModbusExceptionError as refusal:
        if refusal.busy:
            raise
        return WatchdogState(None, f"host side only: the terminal refuses to set register {WATCHDOG}")
    state = await read_watchdog(link)
    # Zero never fires. The terminal may keep another value than was written; a shorter one is safe.
    if state.milliseconds is None or not 0 < state.milliseconds <= wanted_ms:
        what = "the terminal has a watchdog time other than the one set"
        cure = f"set watchdog_ms to {state.milliseconds}, or the terminal's time-out by hand"
        raise ConfigurationError(device, what, cure, value=state.milliseconds, limit=wanted_ms, unit="ms")
    return state


def _fact(milliseconds: int) -> str:
    return f"vents after {milliseconds} ms of silence" if milliseconds else "never fires (0 ms)"

"""Check that a valve terminal is what the configuration states, and leave it vented and guarded."""

from softarm.drivers.clock import Clock
from softarm.drivers.errors import ConfigurationError
from softarm.drivers.health import Health
from softarm.drivers.valves.link import ModbusExceptionError
from softarm.drivers.valves.registers import (
    MODULES_FAULTY,
    MODULES_PRESENT,
    STATUS_FORCE_ACTIVE,
    STATUS_WRITE_PROTECTED,
    TERMINAL_STATUS,
    VtemLayout,
)
from softarm.drivers.valves.terminal import Terminal
from softarm.drivers.valves.vtem import activate
from softarm.drivers.valves.watchdog import WatchdogState, read_watchdog, set_watchdog

MODULE_WORDS = 3


async def identify_terminal(terminal: Terminal, device: str, health: Health) -> tuple[int, ...] | None:
    """Read what there is to read; nothing is written.

    Returns:
        The set-points that stand in the terminal [counts]; None where it does not report them.

    Raises:
        ConfigurationError: The terminal has no valves where they should be.
    """
    try:
        await terminal.probe_echo()
    except ModbusExceptionError as refusal:
        if refusal.busy:
            raise  # does not concern the registers, so it must not end the attempts for good
        what = f"has no {terminal.layout.valves} valves where its kind has them: {refusal.what}"
        raise ConfigurationError(device, what, "check kind and unit of the terminal") from refusal
    standing = (await terminal.read()).inputs.echo
    health.facts["set-points found"] = "cannot be read" if standing is None else _nonzero(standing)
    health.facts["modules"] = await _modules(terminal)
    return standing


async def prepare_terminal(
    terminal: Terminal, device: str, health: Health, clock: Clock, watchdog_ms: int
) -> WatchdogState:
    """Write zeros, start regulation where it needs that, and set the watchdog.

    Raises:
        ConfigurationError: The terminal keeps a longer watchdog than wanted.
    """
    # Zeros first, whichever way: what an earlier host left must not stand while the rest is settled.
    layout = terminal.layout
    if isinstance(layout, VtemLayout):
        await activate(terminal.link, layout, device, clock)
    await terminal.probe_exchange((0,) * layout.valves)
    health.facts["exchange"] = "function 23" if terminal.exchanges else "functions 3 and 16"
    state = await set_watchdog(terminal.link, device, watchdog_ms)
    health.facts["watchdog"] = state.fact
    return state


async def report_watchdog(terminal: Terminal, health: Health) -> WatchdogState:
    """Read the watchdog without setting it."""
    state = await read_watchdog(terminal.link)
    health.facts["watchdog"] = state.fact
    return state


def _nonzero(echo: tuple[int, ...]) -> str:
    return ", ".join(f"valve {valve}: {count}" for valve, count in enumerate(echo) if count) or "all zero"


async def _modules(terminal: Terminal) -> str:
    """Return which modules are there and which report an error, where the terminal reports it."""
    try:
        present = _bits(await terminal.link.read(MODULES_PRESENT, MODULE_WORDS))
        faulty = _bits(await terminal.link.read(MODULES_FAULTY, MODULE_WORDS))
        (status,) = await terminal.link.read(TERMINAL_STATUS, 1)
    except ModbusExceptionError:
        return "not reported"
    summary = f"{len(present)} present, with error: {', '.join(map(str, faulty)) or 'none'}"
    if status & STATUS_FORCE_ACTIVE:
        summary += "; FORCE ACTIVE: outputs do not follow the host"
    if status & STATUS_WRITE_PROTECTED:
        summary += "; parameters write-protected"
    return summary


def _bits(words: tuple[int, ...]) -> list[int]:
    return [16 * index + bit for index, word in enumerate(words) for bit in range(16) if word >> bit & 1]

"""Bringing the slots of a VTEM terminal into pressure regulation, and out of it.

Sequence of the terminal's manual and of tud-cor-sr/ros2-vtem-control: acknowledge errors, start app 3 with
both valves, wait until each slot regulates; to end, exhaust, then mode 61.
"""

import asyncio

from softarm.drivers.clock import NANOSECONDS, Clock
from softarm.drivers.errors import ConnectionLost
from softarm.drivers.valves.link import RegisterLink
from softarm.drivers.valves.registers import (
    INPUTS,
    OUTPUTS,
    VTEM_ACKNOWLEDGE,
    VTEM_BOTH_VALVES,
    VTEM_ERROR,
    VTEM_INACTIVE,
    VTEM_PRESSURE_APP,
    VTEM_READY,
    SlotStatus,
    VtemLayout,
)

ACKNOWLEDGE_S = 0.5
ACTIVATE_S = 20.0
EXHAUST_S = 1.0
DEACTIVATE_S = 10.0
POLL_S = 0.01


async def activate(link: RegisterLink, layout: VtemLayout, device: str, clock: Clock) -> None:
    """Bring every slot into pressure regulation with both set-points at zero.

    Raises:
        ConnectionLost: A slot did not get there in time.
    """
    zeros = [0] * layout.valves
    # Always, also without an error: a slot that kept one from an earlier host would not start.
    await link.write(OUTPUTS, layout.encode_command(VTEM_ACKNOWLEDGE, 1, zeros))
    await asyncio.sleep(ACKNOWLEDGE_S)
    await link.write(OUTPUTS, layout.encode_command(VTEM_PRESSURE_APP, VTEM_BOTH_VALVES, zeros))
    deadline_ns = clock() + round(ACTIVATE_S * NANOSECONDS)
    while idle := [slot for slot, status in await _statuses(link, layout) if not status.regulating]:
        if clock() > deadline_ns:
            raise _late(device, idle, "does not regulate", ACTIVATE_S)
        await asyncio.sleep(POLL_S)


async def deactivate(link: RegisterLink, layout: VtemLayout, device: str, clock: Clock) -> None:
    """Exhaust every slot and leave pressure regulation.

    Raises:
        ConnectionLost: A slot did not get there in time.
    """
    zeros = [0] * layout.valves
    await link.write(OUTPUTS, layout.encode(zeros))
    await asyncio.sleep(EXHAUST_S)  # the chambers must be empty before regulation ends
    await link.write(OUTPUTS, layout.encode_command(VTEM_INACTIVE, 0, zeros))
    deadline_ns = clock() + round(DEACTIVATE_S * NANOSECONDS)
    # A slot in error regulates nothing and would never report that it is ready.
    while busy := [
        slot for slot, status in await _statuses(link, layout) if status.state not in (VTEM_READY, VTEM_ERROR)
    ]:
        if clock() > deadline_ns:
            raise _late(device, busy, "does not leave regulation", DEACTIVATE_S)
        await asyncio.sleep(POLL_S)


async def _statuses(link: RegisterLink, layout: VtemLayout) -> list[tuple[int, SlotStatus]]:
    words = await link.read(INPUTS, layout.read_count)
    return [(slot, SlotStatus.decode(word)) for slot, word in enumerate(words[0::3])]


def _late(device: str, slots: list[int], what: str, limit_s: float) -> ConnectionLost:
    named = ", ".join(str(slot) for slot in slots)
    return ConnectionLost(
        device, f"slot {named} {what}", "check its licence and supply", limit=limit_s, unit="s"
    )

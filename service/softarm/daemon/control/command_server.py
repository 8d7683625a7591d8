"""Answers the commands that come over the network; a stop overtakes all others."""

import logging
from typing import Protocol

from softarm.daemon.network.bus import Bus, Call
from softarm_client.commands import NOT_AFTER_STOP, Applied, Refused

logger = logging.getLogger(__name__)


class Commanded(Protocol):
    """What carries out commands: the control loop."""

    async def answer(self, verb: str, payload: bytes) -> Applied | Refused:
        """Carry out one command."""

    def stop(self, payload: bytes) -> Applied:
        """Stop the arm at once."""


class CommandServer:
    """Carries out each call and answers it once.

    Args:
        bus: Where the calls come from.
        control: Carries them out.
    """

    def __init__(self, bus: Bus, control: Commanded) -> None:
        self._bus = bus
        self._control = control

    async def serve(self, call: Call) -> None:
        """Carry out one command and answer it, unless it would undo a stop that arrived after it."""
        # Checked when it is served, not when it arrives: the stop overtook it in between.
        if self._bus.stopped_since(call) and call.verb in NOT_AFTER_STOP:
            hint = "look at the arm, then send the command again"
            message = "the arm was stopped after this command was sent"
            self._answer(call, Refused(verb=call.verb, code="stale", message=message, hint=hint))
        else:
            self._answer(call, await self._control.answer(call.verb, call.payload))

    def stop(self, call: Call) -> None:
        """Stop the arm and answer."""
        self._answer(call, self._control.stop(call.payload))

    def _answer(self, call: Call, answer: Applied | Refused) -> None:
        if isinstance(answer, Refused):
            logger.warning("%s refused (%s): %s", call.verb, answer.code, answer.message)
        else:
            logger.debug("%s applied in %s: %s", call.verb, answer.mode, answer.applied)
        call.answer(answer)

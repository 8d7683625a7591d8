"""The reply of a Sauter FH or FL gauge (FH manual, p. 13): seven characters, no terminator, on request only.

A reply is framed by its length and by the silence after it. Joining the bytes after a loss to those of the
next reply would yield a wrong number that looks right (`0011.70` `1021.15` less its first byte begins with
`011.701`), so bytes count only between a request and the silence that ends the reply.
"""

import re
from dataclasses import dataclass, field
from typing import Final

from softarm.drivers.framing import ByteCounts, Decoded, FrameFault
from softarm.drivers.gauges.sample import GaugeSample, shows_overload

REQUEST: Final = b"9"
REPLY_LENGTH: Final = 7
_REPLY: Final = re.compile(rb"([01])([ ]{0,4}\d{1,6}(?:\.\d{0,5})?)")


@dataclass(slots=True)
class SauterCodec:
    """Collects one reply at a time: `feed` its bytes, then `silence` to have it."""

    counts: ByteCounts = field(default_factory=ByteCounts)
    _buffer: bytearray = field(default_factory=bytearray)
    _excess: bool = False

    def reset(self) -> None:
        """Forget the bytes so far: a new request goes out."""
        self._buffer.clear()
        self._excess = False

    def feed(self, data: bytes) -> Decoded[GaugeSample]:
        """Collect the next bytes; nothing is complete before the silence."""
        self.counts.received += len(data)
        self.counts.since_frame += len(data)
        room = REPLY_LENGTH - len(self._buffer)
        self._buffer += data[:room]
        self._excess = self._excess or len(data) > room
        return Decoded([], [])

    def silence(self) -> Decoded[GaugeSample]:
        """End the reply: no byte has come for longer than a character takes."""
        reply, excess = bytes(self._buffer), self._excess
        self.reset()
        outcome = FrameFault("overlong", "more than 7 characters") if excess else parse_reply(reply)
        if isinstance(outcome, FrameFault):
            self.counts.skipped += len(reply)
            return Decoded([], [outcome])
        self.counts.since_frame = 0
        return Decoded([outcome], [])


def parse_reply(reply: bytes) -> GaugeSample | FrameFault:
    """Decode the seven characters: '0' compression (minus) or '1' tension, then the number."""
    if not reply:
        return FrameFault("silent", "no reply to the request")
    if len(reply) != REPLY_LENGTH:
        return FrameFault("torn", f"{len(reply)} of 7 characters: {reply!r}")
    match = _REPLY.fullmatch(reply)
    if match is None:
        return FrameFault("digits", f"not a Sauter reading: {reply!r}")
    sign, number = match.groups()
    value = float(number)
    decimals = len(number.partition(b".")[2])
    overload = shows_overload(number.strip().replace(b".", b""))
    return GaugeSample(-value if sign == b"0" else value, None, decimals, overload)

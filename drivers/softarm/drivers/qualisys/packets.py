"""Packets of the Qualisys real-time protocol, little-endian: `u32 size, u32 kind`, then the body.

The size counts its own eight bytes. A size that its kind cannot have means that the stream is hostile or out
of step; nothing after it can be trusted, so the parser stops and the connection is to be closed.
"""

import struct
from enum import IntEnum
from typing import Final

from softarm.drivers.framing import Decoded, FrameFault


class PacketKind(IntEnum):
    """What a packet carries."""

    ERROR = 0
    COMMAND = 1
    XML = 2
    DATA = 3
    NO_MORE_DATA = 4
    C3D_FILE = 5
    EVENT = 6
    DISCOVER = 7
    QTM_FILE = 8
    NONE = 9


class QtmEvent(IntEnum):
    """Events that QTM reports."""

    CONNECTED = 1
    CONNECTION_CLOSED = 2
    CAPTURE_STARTED = 3
    CAPTURE_STOPPED = 4
    CALIBRATION_STARTED = 6
    CALIBRATION_STOPPED = 7
    RT_FROM_FILE_STARTED = 8
    RT_FROM_FILE_STOPPED = 9
    WAITING_FOR_TRIGGER = 10
    CAMERA_SETTINGS_CHANGED = 11
    SHUTTING_DOWN = 12
    CAPTURE_SAVED = 13
    REPROCESSING_STARTED = 14
    REPROCESSING_STOPPED = 15
    TRIGGER = 16


NEVER_A_STATE: Final = frozenset(
    {QtmEvent.CAMERA_SETTINGS_CHANGED, QtmEvent.SHUTTING_DOWN, QtmEvent.CAPTURE_SAVED, QtmEvent.TRIGGER}
)
"""Events that are never the answer to `GetState`."""

Packet = tuple[int, bytes]
"""Kind, and the whole packet with its header."""

HEADER_LENGTH: Final = 8
_MEGABYTE: Final = 1 << 20
SIZES: Final[dict[int, tuple[int, int]]] = {
    PacketKind.ERROR: (8, 64 * 1024),
    PacketKind.COMMAND: (8, 64 * 1024),
    PacketKind.XML: (8, 8 * _MEGABYTE),
    PacketKind.DATA: (24, _MEGABYTE),
    PacketKind.NO_MORE_DATA: (8, 8),
    PacketKind.EVENT: (9, 9),
}
"""Smallest and largest size [bytes] of each kind that this client requests."""

LARGEST_SKIPPED: Final = 16 * _MEGABYTE
"""Largest size [bytes] of a packet of another kind, which is passed over without being kept."""

_DATA: Final = int(PacketKind.DATA)
_DATA_SMALLEST, _DATA_LARGEST = SIZES[PacketKind.DATA]
_HEADER: Final = struct.Struct("<II")
_unpack_header = _HEADER.unpack_from
_new = tuple.__new__  # a named tuple's own constructor costs twice as much


class PacketParser:
    """Cuts the stream of one connection into packets; holds at most one packet of the kinds in `SIZES`."""

    __slots__ = ("_buffer", "_idle", "_needed", "_to_skip", "broken")

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._needed = HEADER_LENGTH
        self._to_skip = 0
        self._idle = True
        self.broken = False

    def feed(self, data: bytes) -> Decoded[Packet]:
        """Decode the next bytes and return the packets and faults that they complete."""
        if self._idle and _DATA_SMALLEST <= len(data) <= _DATA_LARGEST:
            # Usually a segment is one data packet: no copy, at up to 500 of them a second.
            size, kind = _unpack_header(data)
            if size == len(data) and kind == _DATA:
                return _new(Decoded, ([(kind, data)], []))
        decoded: Decoded[Packet] = Decoded([], [])
        if not self.broken:
            self._cut(data, decoded)
        self._idle = not (self._buffer or self._to_skip or self.broken)
        return decoded

    def _cut(self, data: bytes, decoded: Decoded[Packet]) -> None:
        packets, faults = decoded
        buffer = self._buffer
        if self._to_skip:
            data = self._skip(data)
        if buffer:
            buffer += data
            if len(buffer) < self._needed:
                return
            data = bytes(buffer)
            buffer.clear()
        at, end = 0, len(data)
        while end - at >= HEADER_LENGTH:
            size, kind = _unpack_header(data, at)
            smallest, largest = SIZES.get(kind, (HEADER_LENGTH, LARGEST_SKIPPED))
            # Checked before anything waits for it: a size of 0 would loop, one of 4 GB fill the memory.
            if not smallest <= size <= largest:
                faults.append(self._break(size, kind))
                return
            if kind not in SIZES:
                faults.append(FrameFault("unknown", f"a packet of kind {kind}, {size} bytes"))
                self._to_skip = max(0, at + size - end)
                at = min(at + size, end)
                continue
            if end - at < size:
                self._needed = size
                break
            packets.append((kind, data[at : at + size]))
            at += size
        else:
            self._needed = HEADER_LENGTH
        if at < end:
            buffer += data[at:]

    def _skip(self, data: bytes) -> bytes:
        passed = min(self._to_skip, len(data))
        self._to_skip -= passed
        return data[passed:]

    def _break(self, size: int, kind: int) -> FrameFault:
        self.broken = True
        return FrameFault("size", f"a header with size {size} and kind {kind}: not in step, or not QTM")


def encode_command(text: str) -> bytes:
    """Return the packet of a command."""
    body = text.encode() + b"\0"  # the size counts bytes, not characters
    return _HEADER.pack(HEADER_LENGTH + len(body), PacketKind.COMMAND) + body


def packet_text(packet: bytes) -> str:
    """Return the text of an error, command or XML packet."""
    return packet[HEADER_LENGTH:].rstrip(b"\0").decode(errors="replace")

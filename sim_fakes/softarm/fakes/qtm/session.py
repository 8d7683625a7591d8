"""The requests of one client of QTM, and the replies to them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from softarm.fakes.qtm import packets
from softarm.fakes.qtm.packets import COMMAND, COMPONENTS, ERROR, TIMECODE, XML
from softarm.fakes.qtm.settings import Version, parameters

if TYPE_CHECKING:
    from softarm.fakes.qtm.server import QtmServer

WELCOME = "QTM RT Interface connected"
DEFAULT_VERSION: Version = (1, 1)
PARSE_ERROR = "Parse Error"
UDP_PORTS = range(1023, 65536)


@dataclass
class FrameStream:
    """A stream of frames to one client.

    Args:
        components: Components in the order of the request.
        share: Frames sent per frame captured, at most 1.
        udp: Address and port for datagrams; None for the TCP connection.
        credit: Part of a frame that is due; the first captured frame goes out.
    """

    components: tuple[str, ...]
    share: float
    udp: tuple[str | None, int] | None
    credit: float = field(init=False)

    def __post_init__(self) -> None:
        self.credit = 1.0 - self.share

    def due(self) -> bool:
        """Return whether the next captured frame goes out."""
        self.credit += self.share
        if self.credit < 1.0 - 1e-9:  # thirds and tenths do not add up to 1 exactly
            return False
        self.credit -= 1.0
        return True


class ClientSession:
    """The dialogue with one client: one command in, reply bytes out."""

    def __init__(self, software: "QtmServer", peer: str) -> None:
        self.version: Version = DEFAULT_VERSION
        self.stream: FrameStream | None = None
        self.peer = peer
        self._software = software

    def answer(self, command: str) -> bytes:
        """Answer one command.

        Args:
            command: The words of the command packet, without the terminating zero.
        """
        word, _, rest = command.strip().partition(" ")
        handlers = {
            "version": self._version,
            "qtmversion": lambda _: packets.text(COMMAND, "QTM Version is 2.3 (build 464)"),
            "byteorder": lambda _: packets.text(COMMAND, "Byte order is little endian"),
            "getstate": lambda _: packets.event(self._software.last_event),
            "getparameters": self._parameters,
            "getcurrentframe": self._current_frame,
            "streamframes": self._stream_frames,
            "takecontrol": self._take_control,
            "releasecontrol": self._release_control,
            "start": self._start,
            "stop": self._stop,
        }
        handler = handlers.get(word.lower())
        return handler(rest.strip()) if handler else packets.text(ERROR, PARSE_ERROR)

    def close(self) -> None:
        """Release control when the client goes."""
        if self._software.master is self:
            self._software.master = None

    def _version(self, rest: str) -> bytes:
        if not rest:
            return packets.text(COMMAND, f"Version is {self.version[0]}.{self.version[1]}")
        match = re.fullmatch(r"(\d+)\.(\d+)", rest)
        version = (int(match[1]), int(match[2])) if match else (0, 0)
        if not (1, 0) <= version <= self._software.newest_version:
            return packets.text(ERROR, "Version NOT supported")
        self.version = version
        return packets.text(COMMAND, f"Version set to {rest}")

    def _parameters(self, rest: str) -> bytes:
        software = self._software
        xml = parameters(self.version, rest.lower().split(), software.body_names, software.rate)
        return packets.text(ERROR, "Parameters not available") if xml is None else packets.text(XML, xml)

    def _current_frame(self, rest: str) -> bytes:
        components = _components(rest.split())
        if components is None:
            return packets.text(ERROR, PARSE_ERROR)
        frame = self._software.last_frame
        if frame is None:
            return packets.packet(packets.NO_MORE_DATA)
        return packets.data_packet(frame, components)

    def _stream_frames(self, rest: str) -> bytes:
        if rest.lower() == "stop":
            self.stream = None
            return b""
        stream = parse_stream(rest, self._software.rate)
        if stream is None:
            return packets.text(ERROR, PARSE_ERROR)
        if self._software.last_frame is None:
            return packets.packet(packets.NO_MORE_DATA)
        self.stream = stream
        return b""  # QTM acknowledges a stream by its frames alone

    def _take_control(self, rest: str) -> bytes:
        software = self._software
        if software.master is self:
            return packets.text(COMMAND, "You are already master")
        if software.master is not None:
            return packets.text(ERROR, f"{software.master.peer} is already master")
        if rest != software.password:
            return packets.text(ERROR, "Wrong or missing password")
        software.master = self
        return packets.text(COMMAND, "You are now master")

    def _release_control(self, _rest: str) -> bytes:
        self.close()
        return packets.text(COMMAND, "You are now a regular client")

    def _start(self, _rest: str) -> bytes:
        if self._software.master is not self:
            return packets.text(ERROR, "You must be master to issue this command")
        self._software.begin()
        return packets.text(COMMAND, "Starting measurement")

    def _stop(self, _rest: str) -> bytes:
        if self._software.master is not self:
            return packets.text(ERROR, "You must be master to issue this command")
        self._software.end()
        return packets.text(COMMAND, "Stopping measurement")


def parse_stream(rest: str, rate: float) -> FrameStream | None:
    """Read ``[FrequencyDivisor:n | Frequency:n | AllFrames] [UDP[:address]:port] components``.

    Args:
        rest: The words after ``StreamFrames``.
        rate: Camera rate [Hz].

    Returns:
        The stream, or None for a parse error.
    """
    share, udp, words = 1.0, None, rest.split()
    if words and (chosen := _share(words[0].lower(), rate)) is not None:
        share = chosen
        del words[0]
    if words and words[0].lower().startswith("udp:"):
        match = re.fullmatch(r"udp:(?:([^:]+):)?(\d+)", words.pop(0), re.IGNORECASE)
        if match is None or int(match[2]) not in UDP_PORTS:
            return None
        udp = (match[1], int(match[2]))
    components = _components(words)
    return FrameStream(components, share, udp) if components else None


def _share(word: str, rate: float) -> float | None:
    if word == "allframes":
        return 1.0
    match = re.fullmatch(r"(frequency|frequencydivisor):(\d+)", word)
    if match is None or int(match[2]) == 0:
        return None
    number = int(match[2])
    return min(1.0, number / rate) if match[1] == "frequency" else 1.0 / number


def _components(words: Sequence[str]) -> tuple[str, ...] | None:
    names = tuple(word.lower() for word in words)
    return names if names and all(name in COMPONENTS or name == TIMECODE for name in names) else None

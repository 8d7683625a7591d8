"""Incremental framing of byte streams: what every codec of a serial instrument is built on.

A parser takes bytes in any portions and returns the complete frames and the faults. It
holds at most one frame, never raises whatever the bytes, yields the same result however the stream is split,
and finds the next good frame after a bad one, because a candidate that fails its check costs one byte and not
its length.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, Protocol, TypeVar

FrameT = TypeVar("FrameT")
FrameT_co = TypeVar("FrameT_co", covariant=True)


@dataclass(frozen=True, slots=True)
class FrameFault:
    """Something on the wire that is not a frame.

    Args:
        kind: A short stable word to count by, such as `checksum`, `framing`, `value`, `overlong`.
        detail: What was seen, for people.
    """

    kind: str
    detail: str


class Decoded(NamedTuple, Generic[FrameT]):
    """The frames completed by one portion of bytes, and the faults seen in it, in the order of the wire."""

    frames: list[FrameT]
    faults: list[FrameFault]


@dataclass(slots=True)
class ByteCounts:
    """Bytes since the start: all, and those that belonged to no good frame."""

    received: int = 0
    skipped: int = 0
    since_frame: int = 0


class Codec(Protocol[FrameT]):
    """Bytes in, frames and faults out; what `softarm.drivers.serial_link` reads with."""

    @property
    def counts(self) -> ByteCounts:
        """Bytes since the start."""

    def feed(self, data: bytes) -> Decoded[FrameT]:
        """Decode the next bytes of the stream."""

    def reset(self) -> None:
        """Forget a partial frame: the link was opened anew."""


class FrameRule(Protocol[FrameT_co]):
    """How one kind of binary frame begins, how long it is and how to decode it."""

    @property
    def start(self) -> bytes:
        """The bytes that every frame begins with."""

    def length(self, head: bytes) -> int | None:
        """Return the length [bytes] of the frame that begins with `head`, 0 if none can, None if unclear."""

    def decode(self, frame: bytes) -> FrameT_co | FrameFault:
        """Decode a frame of the right length, or return why it is not one."""


@dataclass(slots=True)
class FrameParser(Generic[FrameT]):
    """Cuts a stream into binary frames by start bytes, length and check.

    Bytes before the first good frame are counted and are no fault: the stream was joined in mid-frame. After
    that each loss of the frame boundary is one `framing` fault, and each candidate that fails its check is
    one fault of the rule's kind.

    Args:
        rule: The kind of frame.
        head: Bytes of a frame that the rule needs to determine its length.
    """

    rule: FrameRule[FrameT]
    head: int
    counts: ByteCounts = field(default_factory=ByteCounts)
    _buffer: bytearray = field(default_factory=bytearray)
    _in_step: bool = False
    _joined: bool = False

    def reset(self) -> None:
        """Forget a partial frame and start as on a stream joined in mid-frame."""
        self._buffer.clear()
        self._in_step = False
        self._joined = False

    def feed(self, data: bytes) -> Decoded[FrameT]:
        """Decode the next bytes and return the frames and faults that they complete."""
        self.counts.received += len(data)
        self.counts.since_frame += len(data)
        self._buffer += data
        decoded: Decoded[FrameT] = Decoded([], [])
        at = 0
        while (start := self._seek(at, decoded)) is not None:
            length = self.rule.length(bytes(self._buffer[start : start + self.head]))
            if length is None or start + max(length, 1) > len(self._buffer):
                at = start
                break
            at = self._take(start, length, decoded)
        else:
            at = len(self._buffer) - self._partial_start(at)
        del self._buffer[:at]
        return decoded

    def _seek(self, at: int, decoded: Decoded[FrameT]) -> int | None:
        """Return where the next start bytes stand at or after `at`, counting what is passed over."""
        start = self._buffer.find(self.rule.start, at)
        end = start if start >= 0 else len(self._buffer) - self._partial_start(at)
        if end > at:
            self._lose(end - at, decoded)
        return start if start >= 0 else None

    def _partial_start(self, at: int) -> int:
        """Return how many bytes at the end, but none before `at`, may be the beginning of a start."""
        start, longest = self.rule.start, min(len(self.rule.start) - 1, len(self._buffer) - at)
        return next((n for n in range(longest, 0, -1) if self._buffer.endswith(start[:n])), 0)

    def _take(self, at: int, length: int, decoded: Decoded[FrameT]) -> int:
        """Decode the candidate at `at` and return where to go on."""
        outcome = self.rule.decode(bytes(self._buffer[at : at + length])) if length else None
        if outcome is None or isinstance(outcome, FrameFault):
            if outcome is not None and self._joined:
                decoded.faults.append(outcome)
                self._in_step = False
            self._lose(1, decoded)
            return at + 1  # not its length: that byte may belong to a frame that really begins inside it
        decoded.frames.append(outcome)
        self.counts.since_frame = len(self._buffer) - at - length
        self._in_step = self._joined = True
        return at + length

    def _lose(self, count: int, decoded: Decoded[FrameT]) -> None:
        self.counts.skipped += count
        if self._in_step:
            decoded.faults.append(FrameFault("framing", "bytes that begin no frame"))
            self._in_step = False


class TextLine(NamedTuple):
    """A line without its end, how many bytes had been received when it ended, and whether it is complete."""

    text: bytes
    received: int
    complete: bool = True


@dataclass(slots=True)
class LineParser:
    """Cuts a stream into lines that end in a line feed, with or without a carriage return before it.

    Args:
        longest: Bytes that a line may have; a longer one is dropped to its end and is one `overlong` fault.
        discard_first: Count everything up to the first line end as an incomplete line: the stream is joined
            in mid-line.
        end: The byte that ends a line.
    """

    longest: int = 128
    discard_first: bool = True
    end: bytes = b"\n"
    counts: ByteCounts = field(default_factory=ByteCounts)
    _buffer: bytearray = field(default_factory=bytearray)
    _dropping: bool = field(init=False)

    def __post_init__(self) -> None:
        self._dropping = self.discard_first

    def reset(self) -> None:
        """Forget a partial line."""
        self._buffer.clear()
        self._dropping = self.discard_first

    def feed(self, data: bytes) -> Decoded[TextLine]:
        """Decode the next bytes and return the lines that end in them, without empty ones."""
        self.counts.since_frame += len(data)
        decoded: Decoded[TextLine] = Decoded([], [])
        *pieces, rest = data.split(self.end)
        for piece in pieces:
            self._extend(piece, decoded)
            self.counts.received += len(self.end)
            self._finish(decoded)
        self._extend(rest, decoded)
        return decoded

    def _extend(self, piece: bytes, decoded: Decoded[TextLine]) -> None:
        self.counts.received += len(piece)
        self._buffer += piece
        if self._dropping:
            self.counts.skipped += len(piece)
            del self._buffer[: -self.longest]
        elif len(self._buffer) > self.longest:
            decoded.faults.append(FrameFault("overlong", f"no line end in {self.longest} bytes"))
            self.counts.skipped += len(self._buffer)
            self._buffer.clear()
            self._dropping = True

    def _finish(self, decoded: Decoded[TextLine]) -> None:
        if self._dropping:
            self.counts.skipped += len(self.end)
        complete, self._dropping = not self._dropping, False
        text = bytes(self._buffer).strip(b"\r")
        self._buffer.clear()
        if text:
            decoded.frames.append(TextLine(text, self.counts.received, complete))


@dataclass(slots=True)
class LineCodec(Generic[FrameT]):
    """Decodes a stream of lines, one by one.

    Args:
        parse: Decodes one line without its end, or returns why it cannot.
        lines: Cuts the stream.
        parse_rest: Decodes what is left of an incomplete line, where that is certain without its beginning.
    """

    parse: Callable[[bytes], FrameT | FrameFault]
    lines: LineParser = field(default_factory=LineParser)
    parse_rest: Callable[[bytes], FrameT | None] = lambda rest: None  # noqa: ARG005

    @property
    def counts(self) -> ByteCounts:
        """Bytes since the start."""
        return self.lines.counts

    def reset(self) -> None:
        """Forget a partial line, and the next one where the stream is joined in mid-line."""
        self.lines.reset()

    def feed(self, data: bytes) -> Decoded[FrameT]:
        """Decode the next bytes and return the decoded lines and the faults."""
        lines = self.lines.feed(data)
        decoded: Decoded[FrameT] = Decoded([], lines.faults)
        for line in lines.frames:
            outcome = self.parse(line.text) if line.complete else self.parse_rest(line.text)
            if outcome is None:
                continue
            if isinstance(outcome, FrameFault):
                self.counts.skipped += len(line.text) + 1
                decoded.faults.append(outcome)
            else:
                self.counts.since_frame = self.counts.received - line.received
                decoded.frames.append(outcome)
        return decoded


def checksum8(data: bytes) -> int:
    """Return the sum of the bytes modulo 256."""
    return sum(data) & 0xFF

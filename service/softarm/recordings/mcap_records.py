"""The records of an MCAP file in order, also past damage: a bad chunk costs itself and no other."""

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Metadata
from mcap.stream_reader import breakup_chunk
from zstandard import ZstdError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""Before each record: its kind and its length in bytes."""
CHUNK_MARK = b"\x04\x00\x00\x00zstd"
CHUNK_MARK_AT = HEAD.size + 3 * 8 + 4
"""A chunk names its compression after two times, a size and a checksum; so a chunk can be searched for."""
FOOTER_BYTES = 20
UNREADABLE = (McapError, ZstdError, EOFError, struct.error, ValueError, MemoryError)
"""What the parser raises on damaged bytes; its checksum error and bad UTF-8 are ``ValueError``."""


@dataclass(frozen=True)
class Damage:
    """Bytes that could not be read, between the records around them."""


@dataclass(frozen=True)
class CutOff:
    """The file ends before its footer."""


def walk(data: mmap.mmap | bytes) -> Iterator[McapRecord | Damage | CutOff]:
    """Read every record; those of a chunk come one by one.

    The length of a record leads to the next one, so that damage inside a record costs that record. Where the
    length itself is damaged, the search goes on at the next chunk.
    """
    if data[: len(MAGIC)] != MAGIC:
        yield Damage()
    position = len(MAGIC)
    while not _is_end(data, position):
        end = _end_of_record(data, position)
        if end is None:
            following = _next_chunk(data, position + 1)
            if following is None:
                yield Damage() if data[-len(MAGIC) :] == MAGIC else CutOff()
                return
            yield Damage()
            position = following
            continue
        yield from _records_at(data, position, end)
        position = end


def _is_end(data: mmap.mmap | bytes, position: int) -> bool:
    footer = HEAD.pack(Opcode.FOOTER, FOOTER_BYTES)
    behind = position + HEAD.size + FOOTER_BYTES
    return data[position : position + HEAD.size] == footer and data[behind:] == MAGIC


def _end_of_record(data: mmap.mmap | bytes, position: int) -> int | None:
    """Return the place behind a record, None where no record begins or it is not whole."""
    head = data[position : position + HEAD.size]
    if len(head) < HEAD.size:
        return None
    kind, length = HEAD.unpack(head)
    end = position + HEAD.size + int(length)
    plausible = kind in Opcode._value2member_map_ or _is_chunk(data, position)
    return end if plausible and end <= len(data) else None


def _is_chunk(data: mmap.mmap | bytes, position: int) -> bool:
    at = position + CHUNK_MARK_AT
    return data[position] == Opcode.CHUNK or data[at : at + len(CHUNK_MARK)] == CHUNK_MARK


def _next_chunk(data: mmap.mmap | bytes, start: int) -> int | None:
    """Search for the next whole chunk."""
    at = data.find(CHUNK_MARK, start)
    while at >= 0:
        position = at - CHUNK_MARK_AT
        if position >= start and data[position] == Opcode.CHUNK and _end_of_record(data, position):
            return position
        at = data.find(CHUNK_MARK, at + 1)
    return None


def _records_at(data: mmap.mmap | bytes, position: int, end: int) -> Iterator[McapRecord | Damage]:
    body = bytes(data[position + HEAD.size : end])
    stream = ReadDataStream(BytesIO(body))
    kind = Opcode.CHUNK if _is_chunk(data, position) else data[position]
    try:
        if kind == Opcode.CHUNK:
            records: list[McapRecord] = breakup_chunk(Chunk.read(stream), validate_crc=True)
        elif kind == Opcode.ATTACHMENT:
            if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
                raise ValueError("the checksum does not fit")
            records = [Attachment.read(stream)]
        elif kind == Opcode.CHANNEL:
            records = [Channel.read(stream)]
        elif kind == Opcode.METADATA:
            records = [Metadata.read(stream)]
        else:
            records = []  # indices, which a pass over the whole file does not need
    except UNREADABLE:
        yield Damage()
        return
    yield from records

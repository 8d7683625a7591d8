"""Reading MCAP: whole files, and files cut off by a loss of power up to their last whole chunk."""

import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from zstandard import ZstdError

from softarm.estimator.errors import InputError
from softarm.estimator.recording import Floats, Recording
from softarm.recordings.columns import TIME, column_name
from softarm.recordings.info import parse_info
from softarm.recordings.mcap_writer import INFO_FILE, METADATA
from softarm.recordings.validate import checked_recording

CUT_OFF = "the file was cut off; read up to its last whole chunk"
TEAR = (McapError, CRCValidationError, ZstdError, EOFError, struct.error, UnicodeDecodeError, ValueError)


@dataclass
class Contents:
    """What a pass over a file found.

    Args:
        samples: Column to its times [s] and values, in the file's order.
        attachments: File name to contents.
        columns: Columns that the writer announced.
        torn: Whether the file ends in the middle.
        messages: Number of messages read.
    """

    samples: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    columns: list[str] = field(default_factory=list)
    torn: bool = False
    messages: int = 0


def read_mcap(path: Path, name: str) -> Recording:
    """Read a recording; one that was cut off says so in ``info["recovered"]``.

    Raises:
        InputError: It is no MCAP file or holds no stream of a recording.
    """
    contents = read_contents(path)
    source = str(path)
    times = _times(contents)
    columns = _columns(source, contents, times)
    info = parse_info(f"{source}, {INFO_FILE}", contents.attachments.get(INFO_FILE, b""))
    if contents.torn:
        info["recovered"] = CUT_OFF
    return checked_recording(name, source, columns, info)


def read_contents(path: Path) -> Contents:
    """Read all messages and attachments of a file that may be torn.

    Raises:
        InputError: It is no MCAP file, or was cut off before its first chunk.
    """
    contents = Contents()
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        reader = StreamReader(file, validate_crcs=True, record_size_limit=path.stat().st_size)
        for record in _until_torn(reader, contents):
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                _take(contents, str(path), channels[record.channel_id], record)
            elif isinstance(record, Attachment):
                contents.attachments[record.name] = record.data
            elif isinstance(record, Metadata) and record.name == METADATA:
                contents.columns = json.loads(record.metadata["columns"])
    if contents.torn and not contents.messages:
        raise InputError(
            str(path),
            "is no MCAP file, or was cut off before its first whole chunk",
            "give a file that softarm or another MCAP writer has written",
        )
    return contents


def _until_torn(reader: StreamReader, contents: Contents) -> Iterator[McapRecord]:
    records = iter(reader.records)
    while True:
        try:
            record = next(records)
        except StopIteration:
            return
        except TEAR:
            contents.torn = True
            return
        yield record


def _take(contents: Contents, source: str, channel: Channel, message: Message) -> None:
    """Sort one message's values into their columns; messages of other programs are passed over."""
    contents.messages += 1
    if channel.message_encoding != "json":
        return
    values = json.loads(message.data)
    time = values.pop(TIME, None) if isinstance(values, dict) else None
    if not isinstance(time, int | float):
        return
    for key, value in values.items():
        column = column_name(channel.topic, key)
        if column is None:
            continue
        if not (value is None or isinstance(value, int | float)):
            raise InputError(
                f"{source}, {channel.topic} at {time} s",
                f"{key} is {value!r}, not a number",
                "write null where a reading was lost",
            )
        times, samples = contents.samples.setdefault(column, ([], []))
        times.append(time)
        samples.append(np.nan if value is None else value)


def _times(contents: Contents) -> Floats:
    """Merge the times of all streams."""
    everything = [np.unique(np.array(times)) for times, _ in contents.samples.values()]
    return np.unique(np.concatenate(everything)) if everything else np.empty(0)


def _columns(source: str, contents: Contents, times: Floats) -> Mapping[str, Floats]:
    order = [name for name in contents.columns if name != TIME]
    order += [name for name in contents.samples if name not in order]
    columns: dict[str, Any] = {TIME: times}
    for name in order:
        columns[name] = np.full(len(times), np.nan)
        own_times, samples = contents.samples.get(name, ([], []))
        places = np.searchsorted(times, own_times)
        if len(np.unique(places)) != len(places):
            raise InputError(
                f"{source}, column {name}", "has two messages of the same time", "keep one of them"
            )
        columns[name][places] = samples
    return columns

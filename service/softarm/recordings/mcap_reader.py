"""Reading MCAP: whole files, files cut off by a loss of power, and files with damaged bytes."""

import json
import mmap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, Message, Metadata, Schema

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.recordings.columns import TIME, column_name
from softarm.recordings.info import parse_info
from softarm.recordings.mcap_records import CutOff, Damage, walk
from softarm.recordings.mcap_writer import INFO_FILE, METADATA, STAMPS
from softarm.recordings.validate import checked_recording

CUT_OFF = "the file was cut off; read up to its last whole chunk"


@dataclass
class Contents:
    """Result of a pass over a file.

    Args:
        samples: Column to its times [s] and values, in the file's order.
        attachments: File name to contents.
        columns: Columns that the writer announced.
        torn: Whether the file ends in the middle.
        lost: Stretches that could not be read: from the last time before to the first after [s].
        messages: Number of messages read.
    """

    samples: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    columns: list[str] = field(default_factory=list)
    torn: bool = False
    lost: list[tuple[float, float]] = field(default_factory=list)
    messages: int = 0

    @property
    def flaws(self) -> str:
        """What could not be read, in words; empty when everything was."""
        gaps = [f"damaged: nothing could be read {_span(*stretch)}" for stretch in self.lost]
        return "; ".join([CUT_OFF] * self.torn + gaps)


def _span(begin_s: float, end_s: float) -> str:
    return f"from {begin_s:.3f} s to " + ("its end" if np.isinf(end_s) else f"{end_s:.3f} s")


def read_mcap(path: Path, name: str, *, units_checked: bool = True) -> Recording:
    """Read a recording; ``info["recovered"]`` and ``info["lost_s"]`` state what could not be read.

    Args:
        path: The file.
        name: What reports call it.
        units_checked: Whether values that only another unit explains are refused.

    Raises:
        InputError: It is no MCAP file, holds no stream of a recording, or values that cannot be true.
    """
    contents = read_contents(path)
    source = str(path)
    times = _times(contents)
    columns = _columns(source, contents, times)
    info = parse_info(f"{source}, {INFO_FILE}", contents.attachments.get(INFO_FILE, b""))
    if contents.flaws:
        info["recovered"] = contents.flaws
    if contents.lost:
        info["lost_s"] = [list(stretch) for stretch in contents.lost]
    return checked_recording(name, source, columns, info, units_checked=units_checked)


def read_contents(path: Path) -> Contents:
    """Read all messages and attachments of a file that may be cut off or damaged.

    Raises:
        InputError: It is no MCAP file, or was cut off before its first chunk.
    """
    reader = _Pass(str(path))
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b""
        for record in walk(data):
            if isinstance(record, Schema):
                reader.fields[record.id] = _fields(record)
            elif isinstance(record, Channel):
                reader.channels[record.id] = record
            elif isinstance(record, Message):
                reader.add(record)
            elif isinstance(record, Attachment):
                reader.contents.attachments[record.name] = record.data
            elif isinstance(record, Metadata) and record.name == METADATA:
                reader.contents.columns = json.loads(record.metadata["columns"])
            elif isinstance(record, Damage):
                reader.damaged = True
            elif isinstance(record, CutOff):
                reader.contents.torn = True
    contents = reader.finish()
    if not contents.messages and (contents.torn or contents.lost):
        raise InputError(
            str(path),
            "is not an MCAP file, or was cut off before its first whole chunk",
            "give a file that softarm or another MCAP writer has written",
        )
    return contents


class _Pass:
    """One pass over a file: sorts its messages into columns and notes what was lost between them."""

    def __init__(self, source: str) -> None:
        self.contents = Contents()
        self.channels: dict[int, Channel] = {}
        self.fields: dict[int, tuple[str, ...]] = {}
        self.damaged = False
        self._source = source
        self._last_s = 0.0
        self._unannounced: list[Message] = []

    def add(self, message: Message) -> None:
        """Sort in a message; one whose channel stood in a lost chunk waits for the index at the end."""
        channel = self.channels.get(message.channel_id)
        if channel is None:
            self._unannounced.append(message)
            self._follow(_time_of(message))
        else:
            self.contents.messages += 1
            self._follow(self._sort_in(channel, message))

    def _follow(self, time: float | None) -> None:
        """Keep the time of the last message; the first after damage ends the stretch that is lost."""
        if time is None:
            return
        if self.damaged:
            self.contents.lost.append((self._last_s, time))
            self.damaged = False
        self._last_s = time

    def finish(self) -> Contents:
        """Return the result."""
        if self.damaged:
            self.contents.lost.append((self._last_s, np.inf))
        for message in self._unannounced:
            if channel := self.channels.get(message.channel_id):
                self.contents.messages += 1
                self._sort_in(channel, message)
        return self.contents

    def _sort_in(self, channel: Channel, message: Message) -> float | None:
        """Sort one message's values into their columns; messages of other programs are passed over.

        Returns:
            The message's time [s], None where it has none.
        """
        if channel.message_encoding != "json":
            return None
        values = json.loads(message.data)
        time = values.pop(TIME, None) if isinstance(values, dict) else None
        if not isinstance(time, int | float):
            return None
        announced = dict.fromkeys(self.fields.get(channel.schema_id, ()))
        for key, value in (announced | values).items():  # what is announced and left out was lost
            column = None if key in (TIME, *STAMPS) else column_name(channel.topic, key)
            if column is None:
                continue
            if not (value is None or isinstance(value, int | float)):
                raise InputError(
                    f"{self._source}, {channel.topic} at {time} s",
                    f"{key} is {value!r}, not a number",
                    "leave it out where a reading was lost",
                )
            times, samples = self.contents.samples.setdefault(column, ([], []))
            times.append(time)
            samples.append(np.nan if value is None else value)
        return float(time)


def _fields(schema: Schema) -> tuple[str, ...]:
    """Return the fields that the schema of a JSON channel announces."""
    if schema.encoding != "jsonschema":
        return ()
    try:
        document = json.loads(schema.data)
    except ValueError:
        return ()
    return tuple(document.get("properties", ())) if isinstance(document, dict) else ()


def _time_of(message: Message) -> float | None:
    """Return the time in a message of a channel that is not known yet [s]."""
    try:
        return float(json.loads(message.data)[TIME])
    except (ValueError, TypeError, KeyError):
        return None


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

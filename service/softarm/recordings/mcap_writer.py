"""Writing MCAP: one channel per stream, JSON with its schema, a whole chunk on disk every second.

Values are plain numbers; a lost one is left out, so that every viewer of JSON Schema can plot the rest.
"""

import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema
from numpy.typing import NDArray

from softarm.estimator.recording import POSE_SUFFIXES, Recording
from softarm.recordings.columns import TIME, place
from softarm.recordings.info import format_info
from softarm.recordings.scene import (
    BASE,
    FRAMES,
    SCENE,
    estimated,
    force_scene,
    frame_transforms,
    measured_transforms,
)

LIBRARY = "softarm"
METADATA = "softarm.recording"
STARTED = "started_unix_ns"
"""Key of ``recording.toml``: wall clock at time zero [ns since 1970, UTC]."""
INFO_FILE = "recording.toml"
NANOSECONDS = 1_000_000_000
DRAWN_EVERY_S = 0.05
"""Frames and forces are written for viewers so often; each of their values is in a stream of its own."""
TEXTS: Mapping[str, tuple[str, ...]] = {
    "mode": ("before", "after", "cause", "by"),
    "event": ("kind", "where", "text", "by"),
    "command": ("verb", "mode", "code", "message", "hint"),
}
"""Fields of the messages that carry words; what was applied by a command is an object."""
HOST_STAMP, DEVICE_STAMP = "host_monotonic_ns", "device_time_ns"
STAMPS = (HOST_STAMP, DEVICE_STAMP)
"""Keys of a live message: the host's monotonic clock at its arrival, and the clock of the device."""
UNITS = {"pa": "Pa, gauge", "m": "m", "rad": "rad", "n": "N", "s": "s", "nm": "N m"}


@dataclass(frozen=True)
class Topic:
    """What one channel carries.

    Args:
        name: ``pressures``, ``marker/tip1``.
        fields: Names of the values of a message.
        source: Where the values come from: ``measured``, ``fake+modbus://...``; empty when not known.
    """

    name: str
    fields: tuple[str, ...]
    source: str = ""


@dataclass(frozen=True)
class RecordTimes:
    """When a reading was measured.

    Args:
        t_s: Time of the recording [s].
        host_ns: Host time of arrival: monotonic where the writer has a ``Start``, else that of the file [ns].
        device_ns: The device's own time stamp [ns], the host's where the device has none.
        sequence: The device's counter of messages; 0 where it has none.
    """

    t_s: float
    host_ns: int
    device_ns: int
    sequence: int = 0


@dataclass(frozen=True)
class Start:
    """Both clocks of the host at time zero of a live recording.

    Args:
        monotonic_ns: Monotonic clock [ns].
        unix_ns: Wall clock [ns since 1970, UTC].
    """

    monotonic_ns: int
    unix_ns: int

    @property
    def unix_minus_monotonic_ns(self) -> int:
        """What leads from the monotonic clock to the wall clock [ns]."""
        return self.unix_ns - self.monotonic_ns


class StreamWriter:
    """Writes streams to an open file.

    A chunk is finished, flushed and synchronised whenever ``flush_period_ns`` of host time has passed, so
    that a loss of power costs no more than that; a reader uses the file up to its last whole chunk.

    Args:
        file: Open for writing bytes.
        topics: What will be written; more may be added later.
        attachments: File name to contents, written first: ``recording.toml``, ``specimen.toml``.
        columns: Columns in the order in which a table would have them.
        flush_period_ns: Host time between chunks; ``None`` lets their size decide.
        start: Clocks at time zero of a live recording: log and publish times are then wall-clock times, and
            each message carries the host's monotonic time and the device's.
        metadata: Facts of the run, for programs that read no attachments.
    """

    def __init__(
        self,
        file: IO[bytes],
        topics: Iterable[Topic] = (),
        *,
        attachments: Mapping[str, bytes] | None = None,
        columns: Sequence[str] = (),
        flush_period_ns: int | None = NANOSECONDS,
        start: Start | None = None,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self._file = file
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=LIBRARY)
        header = {"columns": json.dumps(list(columns)), "version": "3", **(metadata or {})}
        self._writer.add_metadata(METADATA, header)
        self._start = start
        for name, data in (attachments or {}).items():
            made_ns = 0 if start is None else start.unix_ns
            self._writer.add_attachment(made_ns, made_ns, name, _media_type(name), data)
        self._channels: dict[str, tuple[int, tuple[str, ...]]] = {}
        self._others: dict[str, int] = {}
        self._drawn_s: dict[str, float] = {}
        self._flush_period_ns = flush_period_ns
        self._last_flush_ns: int | None = None
        for topic in topics:
            self.add_topic(topic)

    def add_topic(self, topic: Topic) -> None:
        """Announce a topic before its first message."""
        schema = self._writer.register_schema(
            f"softarm.{topic.name}", "jsonschema", _schema(topic, stamped=self._start is not None)
        )
        metadata = {"source": topic.source} if topic.source else {}
        channel = self._writer.register_channel(topic.name, "json", schema, metadata)
        self._channels[topic.name] = (channel, topic.fields)

    def write(self, topic: str, values: Sequence[float], stamp: RecordTimes) -> None:
        """Write one message of an announced topic; NaN stands for a lost reading, which is left out."""
        channel, fields = self._channels[topic]
        present = {f: v for f, v in zip(fields, values, strict=True) if math.isfinite(v)}
        self._add(channel, self._stamped(stamp) | present, stamp)
        if topic.startswith("frame/") and fields == POSE_SUFFIXES and len(present) == len(fields):
            self._draw_measured(topic, values, stamp)
        elif topic == "estimate":
            self._draw_estimated(present, stamp)

    def _draw_measured(self, topic: str, pose: Sequence[float], stamp: RecordTimes) -> None:
        if self._drawing_due(topic, stamp):
            transforms = measured_transforms(self.unix_ns(stamp), topic.removeprefix("frame/"), pose)
            self.write_message(FRAMES, transforms, stamp)

    def _draw_estimated(self, values: Mapping[str, float], stamp: RecordTimes) -> None:
        frames, forces = estimated(values)
        if (frames or forces) and self._drawing_due("estimate", stamp):
            unix_ns = self.unix_ns(stamp)
            self.write_message(FRAMES, frame_transforms(unix_ns, BASE, frames), stamp)
            self.write_message(SCENE, force_scene(unix_ns, forces), stamp)

    def _drawing_due(self, topic: str, stamp: RecordTimes) -> bool:
        due = stamp.t_s - self._drawn_s.get(topic, -math.inf) >= DRAWN_EVERY_S
        if due:
            self._drawn_s[topic] = stamp.t_s
        return due

    def write_document(self, topic: str, document: Mapping[str, Any], stamp: RecordTimes) -> None:
        """Write a message of another kind, such as a change of mode; tables leave it out."""
        if topic not in self._others:
            schema = self._writer.register_schema(f"softarm.{topic}", "jsonschema", self._text_schema(topic))
            self._others[topic] = self._writer.register_channel(topic, "json", schema)
        self._add(self._others[topic], {**self._stamped(stamp), **document}, stamp)

    def write_message(self, topic: str, message: Message, stamp: RecordTimes) -> None:
        """Write a message of one of Foxglove's schemas, for viewers; tables leave it out."""
        if topic not in self._others:
            schema = register_schema(self._writer, type(message))
            self._others[topic] = self._writer.register_channel(topic, "protobuf", schema)
        self._add_bytes(self._others[topic], message.SerializeToString(), stamp)

    def unix_ns(self, stamp: RecordTimes) -> int:
        """Return the wall clock at a measurement [ns]; the time of the file where that is not known."""
        return self._times(stamp)[1]

    def _text_schema(self, topic: str) -> bytes:
        numbers = {name: {"type": "number"} for name in (TIME, *(STAMPS if self._start else ()))}
        words = {name: {"type": "string"} for name in TEXTS.get(topic, ())}
        return json.dumps({"title": topic, "type": "object", "properties": numbers | words}).encode()

    def _stamped(self, stamp: RecordTimes) -> dict[str, Any]:
        live = {} if self._start is None else {HOST_STAMP: stamp.host_ns, DEVICE_STAMP: stamp.device_ns}
        return {TIME: stamp.t_s, **live}

    def _times(self, stamp: RecordTimes) -> tuple[int, int]:
        """Return log and publish time: arrival and measurement by the wall clock in a live recording [ns]."""
        if self._start is None:
            return stamp.host_ns, stamp.device_ns
        measured_ns = self._start.unix_ns + round(stamp.t_s * NANOSECONDS)
        return stamp.host_ns + self._start.unix_minus_monotonic_ns, measured_ns

    def _add(self, channel: int, message: Mapping[str, Any], stamp: RecordTimes) -> None:
        data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        self._add_bytes(channel, data, stamp)

    def _add_bytes(self, channel: int, data: bytes, stamp: RecordTimes) -> None:
        log_ns, publish_ns = self._times(stamp)
        self._writer.add_message(channel, log_ns, data, publish_ns, stamp.sequence)
        if self._flush_period_ns is None:
            return
        if self._last_flush_ns is None:
            self._last_flush_ns = stamp.host_ns
        elif stamp.host_ns - self._last_flush_ns >= self._flush_period_ns:
            self.flush()
            self._last_flush_ns = stamp.host_ns

    def flush(self) -> None:
        """Finish the chunk and put it on the disk."""
        # The library finishes a chunk by size alone; the method that does it at a time is private.
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined]
        self._file.flush()
        os.fsync(self._file.fileno())

    def finish(self) -> None:
        """Write the index and the footer; the file stays open."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()


def write_recording(
    recording: Recording, file: IO[bytes], attachments: Mapping[str, bytes] | None = None
) -> None:
    """Write a recording in memory as MCAP.

    A stream gets a message wherever it has a reading; a row without any reading is kept by an empty message.
    """
    streams = streams_of(recording.columns)
    writer = StreamWriter(
        file,
        [Topic(name, tuple(fields)) for name, fields in streams.items()],
        attachments={INFO_FILE: format_info(recording.info), **(attachments or {})},
        columns=list(recording.columns),
        flush_period_ns=None,
    )
    tables = {topic: recording.stack(tuple(fields.values())) for topic, fields in streams.items()}
    present: dict[str, NDArray[np.bool_]] = {
        topic: np.asarray(np.isfinite(table).any(axis=1)) for topic, table in tables.items()
    }
    if present:
        present[next(iter(present))] |= ~np.logical_or.reduce(list(present.values()))
    rows = {topic: table.tolist() for topic, table in tables.items()}
    begin_ns = _begin_ns(recording)
    for index, t_s in enumerate(recording.time.tolist()):
        stamp_ns = begin_ns + round(t_s * NANOSECONDS)
        stamp = RecordTimes(t_s, stamp_ns, stamp_ns, sequence=index)
        for topic, keep in present.items():
            if keep[index]:
                writer.write(topic, rows[topic][index], stamp)
    writer.finish()


def _begin_ns(recording: Recording) -> int:
    """Return the wall clock at time zero [ns]; else one that makes no time negative."""
    begin_ns = recording.info.get(STARTED)
    if isinstance(begin_ns, int) and begin_ns > 0:
        return begin_ns
    return -round(min(0.0, float(recording.time[0])) * NANOSECONDS)


def streams_of(columns: Iterable[str]) -> dict[str, dict[str, str]]:
    """Sort columns into streams: topic to fields, field to column."""
    streams: dict[str, dict[str, str]] = {}
    for column in columns:
        spot = place(column)
        assert spot is not None, column
        streams.setdefault(spot.topic, {})[spot.field] = column
    return streams


def _schema(topic: Topic, *, stamped: bool) -> bytes:
    properties: dict[str, Any] = {TIME: {"type": "number", "description": "time of the recording [s]"}}
    if stamped:
        properties[HOST_STAMP] = {
            "type": "integer",
            "description": "arrival, the host's monotonic clock [ns]",
        }
        properties[DEVICE_STAMP] = {"type": "integer", "description": "the device's clock [ns]"}
    for field in topic.fields:
        unit = UNITS.get(field.rpartition("_")[2], "1")
        properties[field] = {"type": "number", "description": f"[{unit}]; left out: lost reading"}
    schema = {"type": "object", "properties": properties, "required": [TIME]}
    return json.dumps({"title": topic.name, **schema}).encode()


def _media_type(name: str) -> str:
    return "application/toml" if name.endswith(".toml") else "application/octet-stream"

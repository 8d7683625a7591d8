"""What happened during a recording: its messages of the stream ``event``, which no table holds."""

import json
import mmap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message

from softarm.recordings.columns import TIME
from softarm.recordings.load import data_file, is_mcap
from softarm.recordings.mcap_records import walk

TOPIC = "event"


@dataclass(frozen=True)
class RecordedEvent:
    """A change of mode, a finding, or a contact.

    Args:
        time_s: Time of the recording [s].
        kind: ``mode``, ``finding``, ``finding_cleared``, ``contact_begin`` or ``contact_end``.
        where: The arm, a device, stream or process.
        text: What happened, in words.
    """

    time_s: float
    kind: str
    where: str
    text: str


def load_events(path: str | Path) -> tuple[RecordedEvent, ...]:
    """Load the events of a recording in the order of their times; only MCAP holds any.

    Args:
        path: What ``load_recording`` accepts; the file may be cut off or damaged.

    Raises:
        InputError: There is no such recording.
    """
    path = data_file(Path(path))
    if not is_mcap(path) or not path.stat().st_size:
        return ()
    channels: set[int] = set()
    events = []
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for record in walk(data):
            if isinstance(record, Channel) and (record.topic, record.message_encoding) == (TOPIC, "json"):
                channels.add(record.id)
            elif isinstance(record, Message) and record.channel_id in channels:
                events.append(_event(json.loads(record.data)))
    return tuple(sorted(events, key=lambda event: event.time_s))


def _event(values: Mapping[str, Any]) -> RecordedEvent:
    words = (str(values.get(key, "")) for key in ("kind", "where", "text"))
    return RecordedEvent(float(values.get(TIME, 0.0)), *words)

"""A copy of an MCAP file that keeps every message with its stamps, and completes a file that was cut off."""

import mmap
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from softarm.estimator.files import whole_files
from softarm.recordings.info import format_info
from softarm.recordings.mcap_records import walk
from softarm.recordings.mcap_writer import INFO_FILE, LIBRARY


def copy_mcap(source: Path, target: Path, info: Mapping[str, Any]) -> None:
    """Copy what can be read of an MCAP file, whole or not at all.

    Args:
        source: The file; it may be cut off or damaged.
        target: Where to write; what is there is replaced.
        info: What ``recording.toml`` inside the copy shall hold.
    """
    with (
        whole_files(target) as (draft,),
        source.open("rb") as read,
        mmap.mmap(read.fileno(), 0, access=mmap.ACCESS_READ) as data,
        draft.open("wb") as file,
    ):
        _copy(data, file, info)


def _copy(data: mmap.mmap, file: IO[bytes], info: Mapping[str, Any]) -> None:
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(profile="", library=LIBRARY)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, Channel] = {}
    # Channels come first, since one whose chunk is lost is announced again behind its messages.
    for record in walk(data):
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            content = format_info(info) if record.name == INFO_FILE else record.data
            stamps = record.create_time, record.log_time
            writer.add_attachment(*stamps, record.name, record.media_type, content)
    copied = {
        key: writer.register_channel(
            one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata
        )
        for key, one in channels.items()
    }
    for record in walk(data):
        if isinstance(record, Message) and record.channel_id in copied:
            channel = copied[record.channel_id]
            writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
    writer.finish()  # type: ignore[no-untyped-call]

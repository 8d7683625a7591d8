"""Recordings on disk: MCAP, canonical tables as CSV and Parquet, and Qualisys exports.

``load_recording`` and ``save_recording`` are the interface; the suffix of the path decides on the format.
"""

from softarm.recordings.events import load_events
from softarm.recordings.load import load_recording, output_file, read_attachments, save_recording

__all__ = ["load_events", "load_recording", "output_file", "read_attachments", "save_recording"]

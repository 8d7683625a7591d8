"""What a recording holds, one row per stream."""

import numpy as np

from softarm.estimator.recording import Recording
from softarm.recordings.mcap_writer import streams_of

Row = dict[str, str | int | float | bool | None]


def summary(recording: Recording) -> list[Row]:
    """Describe each stream: how many readings, over what time, at what rate, with what gaps.

    Returns:
        Rows with the stream's name, its number of fields, readings, rate [Hz], and longest gap [s].
    """
    rows: list[Row] = []
    for topic, fields in streams_of(recording.columns).items():
        measured = np.isfinite(recording.stack(tuple(fields.values()))).any(axis=1)
        times = recording.time[measured]
        steps = np.diff(times)
        rows.append(
            {
                "stream": topic,
                "fields": len(fields),
                "readings": len(times),
                "from_s": float(times[0]) if len(times) else None,
                "to_s": float(times[-1]) if len(times) else None,
                "rate_hz": float(1.0 / np.median(steps)) if len(steps) else None,
                "longest_gap_s": float(steps.max()) if len(steps) else None,
            }
        )
    return rows

"""A recording in memory: columns over one time axis, an empty cell where a stream had no reading."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats

POSE_SUFFIXES = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
BEND_SUFFIXES = ("x_rad", "y_rad")
MARKER_SUFFIXES = ("x_m", "y_m", "z_m")


@dataclass(frozen=True)
class Recording:
    """Columns of the canonical table in SI units; NaN stands for a lost reading.

    Args:
        name: What reports call it, the folder's or the file's name.
        time: Seconds from the start, strictly increasing, shape (samples,).
        columns: Column name to values, each of shape (samples,).
        info: Metadata of the run (``recording.toml``): ``specimen``, ``rate_hz`` and the other keys of
            docs/recordings.md.
    """

    name: str
    time: Floats
    columns: Mapping[str, Floats]
    info: Mapping[str, Any] = field(default_factory=dict)

    def stack(self, names: tuple[str, ...]) -> Floats:
        """Stack columns side by side, shape (samples, columns)."""
        return np.column_stack([self.columns[name] for name in names])

    def members(self, pattern: str) -> tuple[str, ...]:
        """List the first group of every column name that matches, in order of first appearance."""
        matches = (re.fullmatch(pattern, name) for name in self.columns)
        return tuple(dict.fromkeys(match.group(1) for match in matches if match))

    @property
    def start(self) -> float:
        """When it began by the clock of its session [s], which goes on between recordings."""
        return float(self.info.get("session_start_s", 0.0))

    @property
    def chambers(self) -> tuple[int, ...]:
        """Chambers with a measured or a commanded pressure."""
        return tuple(sorted(int(k) for k in self.members(r"pressure_(?:cmd_)?(\d+)_pa")))

    @property
    def frames(self) -> tuple[str, ...]:
        """Sections with a pose."""
        return self.members(r"frame_(.+)_qw")

    @property
    def bends(self) -> tuple[str, ...]:
        """Sections with a two-axis bend."""
        return self.members(r"bend_(.+)_x_rad")

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers."""
        return self.members(r"marker_(.+)_x_m")

    @property
    def gauges(self) -> tuple[str, ...]:
        """Names of the force gauges."""
        return self.members(r"gauge_(.+)_n")

    def pressure(self, chamber: int) -> tuple[Floats, str]:
        """Return a chamber's gauge pressure [Pa] and its source.

        It is the ``measured`` one, or the ``commanded`` one where none was measured.
        """
        measured = self.columns.get(f"pressure_{chamber}_pa")
        commanded = self.columns.get(f"pressure_cmd_{chamber}_pa")
        # A column of nothing but lost readings: the sensor was configured and never answered.
        if measured is None or (commanded is not None and not np.isfinite(measured).any()):
            return self.columns[f"pressure_cmd_{chamber}_pa"], "commanded"
        return measured, "measured"

    def bend(self, section: str) -> Floats:
        """Return a section's two-axis bend [rad], shape (samples, 2)."""
        return self.stack(tuple(f"bend_{section}_{suffix}" for suffix in BEND_SUFFIXES))

    def pose(self, section: str) -> Floats:
        """Return a section's pose: position [m] and quaternion (w, x, y, z), shape (samples, 7)."""
        return self.stack(tuple(f"frame_{section}_{suffix}" for suffix in POSE_SUFFIXES))

    def marker(self, name: str) -> Floats:
        """Return a marker's position in the laboratory frame [m], shape (samples, 3)."""
        return self.stack(tuple(f"marker_{name}_{suffix}" for suffix in MARKER_SUFFIXES))

    def gauge(self, name: str) -> Floats:
        """Return a gauge's force along its own axis [N], pull positive, shape (samples,)."""
        return self.columns[f"gauge_{name}_n"]

    def window(self, keep: NDArray[np.bool_]) -> "Recording":
        """Keep some samples, shape (samples,)."""
        return Recording(self.name, self.time[keep], {k: v[keep] for k, v in self.columns.items()}, self.info)

"""By how much a diagnosed recording and its model differ, without and with the findings."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.motion import HELDOUT
from softarm.estimator.effects.amounts import readable
from softarm.estimator.recording import Recording
from softarm.page import readings
from softarm.page.text import plain

RESIDUAL = re.compile(r"estimate_residual_before_(.+)_(rad|m|pa)")
UNITS = {"rad": "rad", "m": "m", "pa": "Pa"}
COLOURS = {"before": "#d95f02", "after": "#1b7f79"}
"""As in the report."""
ROWS = 8
"""Number of channels that are listed: those with the largest residuals before."""


@dataclass(frozen=True)
class Channel:
    """A channel's residuals.

    Args:
        name: Its name, such as ``bend_tip_x``.
        unit: ``rad``, ``m`` or ``Pa``.
        noise: Standard deviation of its noise, in the unit.
        before: Measured minus predicted without the findings, NaN where lost, shape (samples,).
        after: The same with them.
    """

    name: str
    unit: str
    noise: float
    before: Floats
    after: Floats

    def row(self, index: int) -> str:
        """Write both residuals of a sample."""
        factor, unit = readable(self.unit)
        values = (factor * float(values[index]) for values in (self.before, self.after))
        cells = (f"{v:z.2f} {unit}" if np.isfinite(v) else '<span class="fault">lost</span>' for v in values)
        return f"<tr><td>{plain(self.name)}</td>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


class MismatchOverTime:
    """Reads the residuals in a recording of a diagnosis.

    Args:
        recording: With the columns of ``softarm.estimator.diagnosis.motion``.
        noise: Standard deviation of the noise of each channel; others are left out.
    """

    def __init__(self, recording: Recording, noise: Mapping[str, float]) -> None:
        self._recording = recording
        floors = {name.replace(".", "_"): floor for name, floor in noise.items()}
        found = [match for match in map(RESIDUAL.fullmatch, recording.columns) if match]
        channels = [
            Channel(match[1], UNITS[match[2]], floors[match[1]], *self._residuals(match[0]))
            for match in found
            if match[1] in floors
        ]
        self._channels = sorted(channels, key=lambda one: -_mean_square(one.before / one.noise))
        self.before, self.after = (
            _root_mean_square([getattr(one, which) / one.noise for one in channels], len(recording.time))
            for which in COLOURS
        )
        """Root mean square over the channels, each over its noise, shape (samples,)."""

    def _residuals(self, before: str) -> tuple[Floats, Floats]:
        columns = self._recording.columns
        return columns[before], columns[before.replace("_before_", "_after_", 1)]

    def at(self, time_s: float) -> str:
        """Write the residuals of the channels at a time of the recording [s]."""
        index = max(int(np.searchsorted(self._recording.time, time_s, side="right")) - 1, 0)
        rows = "".join(one.row(index) for one in self._channels[:ROWS])
        heads = (
            f'<th><span class="legend" style="background:{colour}">{which}</span></th>'
            for which, colour in COLOURS.items()
        )
        unseen = self._recording.columns[HELDOUT][index] == 1.0
        note = "The diagnosis has not used these data." if unseen else "The diagnosis has used these data."
        table = f"<table><tr><th>channel</th>{''.join(heads)}</tr>{rows}</table>{note}"
        return readings.reading("channels", table, f"Measured minus predicted at {time_s:.2f} s")


def _mean_square(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.mean(finite**2)) if len(finite) else 0.0


def _root_mean_square(channels: Sequence[Floats], samples: int) -> Floats:
    """Return the root mean square over channels at each sample, 0 where all are lost."""
    values = np.array(channels).reshape(-1, samples)
    finite = np.isfinite(values)
    squares = np.where(finite, values, 0.0) ** 2
    return np.asarray(np.sqrt(squares.sum(axis=0) / np.maximum(finite.sum(axis=0), 1)))

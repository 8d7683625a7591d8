"""One recording of a diagnosis: what acted, what was read, how well, in samples of even length."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.sensing import ActuationMap, SensorSuite
from softarm.estimator.simulation import Drive

LONGER = 50
"""Factor between spans that determine a step: rounding must not amount to half a step of the longer one."""


@dataclass(frozen=True)
class Session:
    """A recording brought to the rate of a diagnosis.

    Args:
        name: Name of the recording.
        nominal: Whether it shows the arm in its known state.
        clock: Time of the session's clock [s], which goes on between recordings, shape (samples,).
        pressures: Recorded gauge pressures [Pa], shape (samples, chambers).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (samples, 3).
        wrenches: Known loads on the sections, as in ``Drive``, shape (samples, sections, 6).
        suite: The sensors.
        readings: Stacked readings, NaN where lost, shape (samples, readings).
        sigma: Standard deviation of each row's noise in a sample, shape (rows,).
        blocks: Number of the stretch of time that each sample belongs to, shape (samples,).
        heldout: Samples that no fit may see, shape (samples,).
        natural_frequency: At which the arm vibrated when it was released [Hz].
        event_readings: Readings during events, NaN elsewhere, which no fit may see, shape (samples,
            readings); ``None`` where nothing happened.
        commanded: Whether some of the pressures are set-points.
        confirms: Of those held out, the samples on which a choice is confirmed, shape (samples,); the others
            decide nothing.
        start: When the recording began by the session's clock [s]: what its own times are counted from.
    """

    name: str
    nominal: bool
    clock: Floats
    pressures: Floats
    gravity: Floats
    wrenches: Floats
    suite: SensorSuite
    readings: Floats
    sigma: Floats
    blocks: Indices
    heldout: Flags
    natural_frequency: float | None = None
    event_readings: Floats | None = None
    commanded: bool = True
    confirms: Flags | bool = False
    start: float = 0.0

    @property
    def time(self) -> Floats:
        """Times as the recording states them [s], in which every report counts, shape (samples,)."""
        return self.clock - self.start

    @property
    def reported(self) -> Flags:
        """Samples that neither a fit nor a choice may see, shape (samples,)."""
        return np.asarray(self.heldout & ~np.asarray(self.confirms), dtype=np.bool_)

    @property
    def with_events(self) -> "Session":
        """The same session with what was read during events, which no fit may see."""
        events = self.event_readings
        if events is None:
            return self
        return replace(self, readings=np.where(np.isfinite(events), events, self.readings))

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.clock)

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return float(self.clock[-1] - self.clock[0])

    @cached_property
    def step(self) -> float:
        """Time between samples [s].

        A difference of neighbours carries the rounding of the clock, a quarter of a microsecond in seconds
        since 1970, which over minutes is a sample. Longer spans determine the step better, once a shorter
        one has shown how many steps they are.
        """
        step, lag = float(np.median(np.diff(self.clock))), LONGER
        while lag < len(self.clock) // 8:  # few spans hold a gap then
            span = float(np.median(self.clock[lag:] - self.clock[:-lag]))
            step, lag = span / max(round(span / step), 1), LONGER * lag
        return step

    def drive(self, actuation: ActuationMap, segments: int) -> Drive:
        """Return what acts on the arm, the actuation's gains and biases included."""
        acting = actuation.to_chamber(self.pressures)
        sections = self.wrenches.shape[1]
        plain = Drive.of(self.clock, acting, self.gravity, sections, segments)
        return replace(plain, wrenches=self.wrenches)

    def thin(self, keep: Flags) -> "Session":
        """Keep some samples, shape (samples,)."""
        return replace(
            self,
            clock=self.clock[keep],
            pressures=self.pressures[keep],
            gravity=self.gravity[keep],
            wrenches=self.wrenches[keep],
            readings=self.readings[keep],
            blocks=self.blocks[keep],
            heldout=self.heldout[keep],
            event_readings=None if self.event_readings is None else self.event_readings[keep],
            confirms=self.confirms if isinstance(self.confirms, bool) else self.confirms[keep],
        )


def channels(suite: SensorSuite) -> tuple[str, ...]:
    """Name the rows of a suite's innovation: ``bend_tip.x``, ``frame_tip.rz``, ``marker_tip1.y``."""
    letters = {2: ("x", "y"), 3: ("x", "y", "z"), 6: ("x", "y", "z", "rx", "ry", "rz")}
    return tuple(f"{m.name}.{letter}" for m in suite.measurements for letter in letters[m.size])

"""What the intake of a recording found: faults of frames, labels, units and clocks, and events."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.series import inside

Kind = Literal["unit", "offset", "sign", "labels", "frame", "clock", "limit", "lost", "stuck", "structure"]
NO_MISMATCH = ("limit", "lost")
"""Kinds that report which readings were left out, and no error of frames, labels, units or clocks."""
MOTION = ("bend_", "frame_", "marker_")


@dataclass(frozen=True)
class RecordingFault:
    """A part of a recording that does not fit the specimen in its frame, label, unit or clock.

    Args:
        recording: Name of the recording.
        kind: What kind of fault.
        columns: Streams or columns at fault.
        what: The fault with its numbers, without a full stop.
        cure: What was done for this run, or what the user can do.
        corrected: Whether the run was corrected; otherwise it is refused.
        odds: Odds of this explanation against the next; infinite where there is no other.
        interval: From when to when [s], where it does not concern the whole recording.
        mirrored: Number of the laboratory's axis that was found to be mirrored, if one was.
    """

    recording: str
    kind: Kind
    columns: tuple[str, ...]
    what: str
    cure: str
    corrected: bool = True
    odds: float = np.inf
    interval: tuple[float, float] | None = None
    mirrored: int | None = None

    @property
    def statement(self) -> str:
        """The fault and what was done about it, one sentence."""
        return f"{self.recording}: {self.what}; {self.cure}."

    @property
    def error(self) -> InputError:
        """The refusal."""
        return InputError(self.recording, self.what, self.cure)


@dataclass(frozen=True)
class Disturbance:
    """A stretch of time that no steady law of the arm explains.

    Args:
        recording: Name of the recording.
        interval: From when to when [s].
        channels: Streams that moved.
        size_rad: Largest unexplained angle [rad], 0 where no angle was recorded.
        size_m: Largest unexplained displacement [m], of the tip where only bends were recorded.
        usual_rad: Rms of the law's own error in angle [rad] outside of events.
        usual_m: The same in length [m].
        probability: That a steady law does not explain it.
        equivalent: Chamber and pressure [Pa] that would do the same; ``None`` where none does.
    """

    recording: str
    interval: tuple[float, float]
    channels: tuple[str, ...]
    size_rad: float
    size_m: float
    usual_rad: float
    usual_m: float
    probability: float
    equivalent: tuple[int, float] | None = None

    def joined(self, other: "Disturbance") -> "Disturbance":
        """Return this event and another of the same recording as one, which is like the larger of them."""
        larger = max(self, other, key=lambda one: (one.size_rad, one.size_m))
        return replace(
            larger,
            interval=(min(self.interval[0], other.interval[0]), max(self.interval[1], other.interval[1])),
            channels=tuple(dict.fromkeys((*self.channels, *other.channels))),
            size_m=max(self.size_m, other.size_m),
            probability=max(self.probability, other.probability),
        )

    @property
    def statement(self) -> str:
        """When, where, how large and what would do the same, one sentence."""
        sizes = [
            f"{np.degrees(self.size_rad):.1f} degrees (usual error {np.degrees(self.usual_rad):.1f})"
            if self.size_rad
            else "",
            f"{1e3 * self.size_m:.0f} mm"
            + (f" (usual error {1e3 * self.usual_m:.1f})" if self.usual_m else ""),
        ]
        size = " and ".join(filter(None, sizes))
        begin, end = self.interval
        like = ""
        if self.equivalent is not None:
            chamber, pressure = self.equivalent
            like = f", as {pressure / 1e3:+.1f} kPa in chamber {chamber} would"
        return (
            f"{self.recording}: from {begin:.1f} to {end:.1f} s {', '.join(self.channels)} moved by up to "
            f"{size} in a way that no steady law of the pressures explains{like}; left out of every fit."
        )


@dataclass(frozen=True)
class Intake:
    """A recording after intake.

    Args:
        recording: The recording, corrected where that was unambiguous.
        mismatches: What did not fit.
        events: Stretches that no steady law explains.
        excluded: Stretches [s] that no fit may see, those of events among them.
        beyond: Those among them in which a pressure passes its limit, which no estimate may see either.
    """

    recording: Recording
    mismatches: tuple[RecordingFault, ...] = ()
    events: tuple[Disturbance, ...] = ()
    excluded: tuple[tuple[float, float], ...] = ()
    beyond: tuple[tuple[float, float], ...] = ()

    @property
    def refusals(self) -> tuple[InputError, ...]:
        """Faults that could not be corrected unambiguously."""
        return tuple(one.error for one in self.mismatches if not one.corrected)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All that was found, one sentence each."""
        corrected = (one.statement for one in self.mismatches if one.corrected)
        return (*corrected, *(event.statement for event in self.events))

    @property
    def for_fits(self) -> Recording:
        """The recording as a fit may see it: its motion counts as lost during excluded stretches."""
        return without_motion(self.recording, self.excluded)

    @property
    def for_estimates(self) -> Recording:
        """The recording as an estimate may see it: events are there to be estimated, burst limits are not."""
        return without_motion(self.recording, self.beyond)

    def with_events(self, recording: Recording) -> Recording:
        """Return this recording, as a fit may see it, with what was read during events.

        Args:
            recording: As of ``for_fits``, perhaps with other pressures.
        """
        intervals = [event.interval for event in self.events]
        others = [stretch for stretch in self.excluded if stretch not in intervals]
        during = inside(recording.time, intervals) & ~inside(recording.time, others)
        columns = {
            name: np.where(during, self.recording.columns[name], values)
            if name.startswith(MOTION)
            else values
            for name, values in recording.columns.items()
        }
        return replace(recording, columns=columns)

    def required(self) -> "Intake":
        """Return this intake unless the recording is refused.

        Raises:
            InputError: A fault could not be corrected.
        """
        if self.refusals:
            raise self.refusals[0]
        return self

    def with_recording(self, recording: Recording, faults: Sequence[RecordingFault] = ()) -> "Intake":
        """Return this intake with another recording and further mismatches."""
        return replace(self, recording=recording, mismatches=(*self.mismatches, *faults))


def without_motion(recording: Recording, stretches: Sequence[tuple[float, float]]) -> Recording:
    """Return a recording whose motion is lost during some stretches [s]; the pressures stay."""
    lost = inside(recording.time, stretches)
    if not lost.any():
        return recording
    columns = {
        name: np.where(lost, np.nan, values) if name.startswith(MOTION) else values
        for name, values in recording.columns.items()
    }
    return replace(recording, columns=columns)

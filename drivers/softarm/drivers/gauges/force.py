"""Conversion of samples to forces: unit, direction, tare, and what the operator changes on the instrument."""

from dataclasses import dataclass
from typing import Final

from softarm.drivers.gauges.sample import NEWTON_PER, GaugeSample

STEP: Final = 0.2
"""Smallest load [N] whose fall to zero from one reading to the next may be somebody pressing zero."""


@dataclass(frozen=True, slots=True)
class GaugeForce:
    """One reading of a force gauge.

    Args:
        force: Pull on the gauge, less the tare [N].
        gross: Pull on the gauge as it shows [N].
        resolution: One step of its display [N].
        unit: Unit of its display.
        stable: Whether the gauge reports that it has settled, where it does.
    """

    force: float
    gross: float
    resolution: float
    unit: str
    stable: bool | None = None


@dataclass(frozen=True, slots=True)
class Judged:
    """A force, whether it may be used, and why not or what is special."""

    force: GaugeForce
    valid: bool
    flags: tuple[str, ...]
    events: tuple[str, ...]


@dataclass(slots=True)
class ForceScale:
    """Converts samples to forces and notices what the operator changes on the instrument.

    Args:
        pull_sign: Sign of a pull on the display, +1 or -1.
        unit: Unit where the instrument does not send it.
        tare: Pull that counts as zero [N].
    """

    pull_sign: int
    unit: str | None
    tare: float = 0.0
    _shown: tuple[str, int] | None = None
    _last: float | None = None

    def restart(self) -> None:
        """Forget the last sample: the connection is new."""
        self._last = None

    def gross(self, sample: GaugeSample, unit: str | None = None) -> float:
        """Return the pull that a sample shows [N], 0 if its unit is not known."""
        return self.pull_sign * sample.value * NEWTON_PER.get(sample.unit or unit or self.unit or "", 0.0)

    def judge(self, sample: GaugeSample, unit: str | None = None) -> Judged:
        """Return the force that a sample shows.

        Args:
            sample: What the instrument sent.
            unit: Its unit, where the sample lacks it and the instrument reported it otherwise.
        """
        unit = sample.unit or unit or self.unit or ""
        per = NEWTON_PER.get(unit, 0.0)
        gross = self.gross(sample, unit)
        force = GaugeForce(gross - self.tare, gross, per / 10**sample.decimals, unit, sample.stable)
        flags = [
            flag for flag, holds in (("over_range", sample.over_range), ("unit_unknown", not per)) if holds
        ]
        events = self._changes(sample, unit, gross, force.resolution) if not flags else []
        return Judged(force, not flags, (*flags, *events), tuple(events))

    def _changes(self, sample: GaugeSample, unit: str, gross: float, resolution: float) -> list[str]:
        """Name what has changed since the sample before."""
        shown = (unit, sample.decimals)
        before, self._shown = self._shown, shown
        last, self._last = self._last, gross
        events = []
        if before is not None and before[0] != shown[0]:
            events.append("unit_changed")
        if before is not None and before[1] != shown[1] and before[0] == shown[0]:
            events.append("decimals_changed")
        if last is not None and abs(last) >= STEP and abs(gross) <= 2 * resolution:
            events.append("step_to_zero")
        return events

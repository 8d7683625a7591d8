"""Stretches in which a pressure passes the limit of the specimen."""

import numpy as np

from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.series import joined
from softarm.estimator.specimen import Specimen

OVERSHOOT = 1.1
"""A measured pressure may pass the limit that commands must keep by this factor."""
MOST = 0.5
"""Share of a recording above the limit from which it is refused."""
GUARD = 0.5
"""What is left out on either side [s]."""


def over_limit(
    recording: Recording, specimen: Specimen
) -> tuple[tuple[tuple[float, float], ...], tuple[RecordingFault, ...]]:
    """Find the stretches [s] above the limit of a chamber, which neither a fit nor an estimate may see.

    Returns:
        The stretches, and one mismatch that names them; both empty where every pressure keeps its limit.
    """
    above = np.zeros(len(recording.time), dtype=bool)
    words = []
    for chamber in recording.chambers:
        if chamber >= len(specimen.pressure_limits):
            continue
        values, source = recording.pressure(chamber)
        limit = specimen.pressure_limits[chamber]
        over = np.nan_to_num(values) > limit * (OVERSHOOT if source == "measured" else 1.0)
        if over.any():
            highest = float(np.nanmax(values)) / 1e3
            words.append(f"chamber {chamber} reaches {highest:.1f} kPa over its limit of {limit / 1e3:.0f}")
        above |= over
    if not above.any():
        return (), ()
    stretches = _stretches(recording, above)
    what = f"{'; '.join(words)} for {above.mean():.0%} of the time"
    if above.mean() > MOST:
        cure = (
            "check the unit and the zero of these pressures: gauge pressures in Pa are expected; raise "
            "pressure_limit_pa in the specimen only if it is known that the arm withstands them"
        )
        return stretches, (
            RecordingFault(recording.name, "limit", ("pressures",), what, cure, corrected=False),
        )
    listed = ", ".join(f"{begin:.1f} to {end:.1f} s" for begin, end in stretches[:5])
    more = f" and {len(stretches) - 5} more" if len(stretches) > 5 else ""
    return stretches, (
        RecordingFault(
            recording.name,
            "limit",
            ("pressures",),
            what,
            f"left out of every fit and estimate: {listed}{more}",
        ),
    )


def _stretches(recording: Recording, above: np.ndarray) -> tuple[tuple[float, float], ...]:
    near = joined(recording.time[above].tolist(), 2.0 * GUARD)
    return tuple((first - GUARD, last + GUARD) for first, last in near)

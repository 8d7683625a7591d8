"""Signs: gauges whose cord would push, pressures below that of the air."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen

SIGN = 5.0
"""A gauge on a cord reads pulls of one sign; so many times larger on the other side it is wired the
wrong way."""
PULL = 0.05
"""Pulls below it [N] show no sign."""


BELOW = 0.15
"""Share of the limit by which pressures may fall below that of the air."""


def correct_signs(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Reverse the sign of gauges whose cord would push, and refuse pressures far below that of the air."""
    suction = _suction(recording, specimen)
    return (recording, suction) if suction else _pull_signs(recording)


def _suction(recording: Recording, specimen: Specimen) -> tuple[RecordingFault, ...]:
    for chamber in recording.chambers:
        values = recording.pressure(chamber)[0]
        valid = values[np.isfinite(values)]
        low = float(np.percentile(valid, 2.0)) if len(valid) else 0.0
        if low < -BELOW * specimen.pressure_limits[chamber]:
            what = f"the pressure of chamber {chamber} falls to {low / 1e3:.1f} kPa below that of the air"
            cure = "reverse its sign, or add what its sensor reads when vented"
            return (
                RecordingFault(
                    recording.name, "sign", (f"pressure_{chamber}_pa",), what, cure, corrected=False
                ),
            )
    return ()


def _pull_signs(recording: Recording) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Reverse the sign of gauges whose cord would push: pull is positive, and a cord cannot push."""
    columns, faults = dict(recording.columns), []
    tied: Mapping[str, object] = {**recording.info, **({"hook": True} if "hook" in recording.markers else {})}
    if not {"hook", "gauge_section", "gauge_direction"} & set(tied):
        return recording, ()
    for name in recording.gauges:
        force = recording.gauge(name)
        valid = force[np.isfinite(force)]
        if not len(valid):
            continue
        push, pull = -float(np.percentile(valid, 0.5)), float(np.percentile(valid, 99.5))
        if push > PULL and push > SIGN * max(pull, 0.0):
            columns[f"gauge_{name}_n"] = -force
            what = f"gauge {name} reads {-push:.3g} N at most, as if its cord pushed: its sign is reversed"
            faults.append(
                RecordingFault(recording.name, "sign", (f"gauge_{name}_n",), what, "reversed for this run")
            )
    return (replace(recording, columns=columns), tuple(faults)) if faults else (recording, ())

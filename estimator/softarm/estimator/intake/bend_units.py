"""Units of bends, section by section: what lies around itself in radians is in degrees.

Another bend is compared with it. Chambers bend the segments of an arm by angles of one size, so a bend that
would be some fifty times smaller in degrees is in radians.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.hypotheses import Explanation, choose
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import BEND_SUFFIXES, Recording
from softarm.estimator.specimen import Specimen

FULL_CIRCLE = 2.0 * np.pi
"""Bend [rad] that no section reaches: it would lie around itself."""
ANGLES = {"radians": (1.0, 0.0), "degrees": (np.pi / 180.0, -3.0)}
"""Factor to radians and logarithm of the prior over that of the others."""
ALIKE = 0.05
"""What chambers that are filled alike do apart, over what they do together, below which it is no more than
the few percent by which valves err."""
SEGMENTS_DIFFER = np.log(10.0) / 3.0
"""Spread of the logarithm of the bend of one segment over that of another: three of it are a factor of ten,
by which the segments of no arm differ."""
SEEN = 0.7
"""Share of the variance of bends that pressures leave at most where they show how far they bend the arm."""
DRIVEN = 0.2
"""Share of the largest change of a pressure from which a chamber is driven."""


def around_themselves(recording: Recording) -> tuple[str, ...]:
    """List the sections whose bends are larger than any in radians."""
    bends = {section: np.linalg.norm(recording.bend(section), axis=1) for section in recording.bends}
    read = {section: bend[np.isfinite(bend)] for section, bend in bends.items()}
    return tuple(s for s, bend in read.items() if len(bend) and np.percentile(bend, 99.5) > FULL_CIRCLE)


def mixed_bends(
    recording: Recording, aligned: Recording, specimen: Specimen
) -> tuple[tuple[str, ...], tuple[RecordingFault, ...]]:
    """Find the sections whose bends are in degrees beside others in radians; refuse where it is not clear.

    A section whose bend passes a whole turn is in degrees. Another one is too, unless its bend is then far
    smaller than that of the first while its own chambers are driven.

    Args:
        recording: As it was recorded.
        aligned: The same with pressures and motion on one clock.
        specimen: The robot.

    Returns:
        Sections to convert, none where all are in one unit, and what was found.
    """
    certain = around_themselves(recording)
    swings = _swings(aligned, specimen)
    known = [swings[section] for section in certain if section in swings]
    others = [s for s in recording.bends if s not in certain and s in swings]
    if not known or not others:
        return (), ()
    choices = {section: choose(_beside_degrees(swings[section] / max(known))) for section in others}
    radians = [section for section, choice in choices.items() if choice.best.what == "radians"]
    unclear = [section for section, choice in choices.items() if not choice.unambiguous]
    if not radians and not unclear:
        return (), ()
    found = _tops(recording, certain)
    odds = min(choice.odds for choice in choices.values())
    if unclear:
        what = f"{found} and must be in degrees; {_tops(recording, unclear)}, in degrees or in radians"
        cure = f"give all bends in radians (odds only {odds:.0f})"
        columns = angle_columns(recording.bends)
        return (), (RecordingFault(recording.name, "unit", columns, what, cure, False, odds),)
    what = f"{found} and must be in degrees; {_tops(recording, radians)}, in radians"
    same = tuple(section for section in recording.bends if section not in radians)
    cure = f"the bends of {', '.join(same)} were converted for this run"
    return same, (RecordingFault(recording.name, "unit", angle_columns(same), what, cure, True, odds),)


def _beside_degrees(ratio: float) -> list[Explanation[str]]:
    """Compare the units of a bend beside one in degrees, by the ratio of both as recorded."""
    return [
        Explanation(
            unit,
            (ANGLES["degrees"][1] if unit == "radians" else 0.0)
            - 0.5 * float(np.log(ratio * factor / ANGLES["degrees"][0]) / SEGMENTS_DIFFER) ** 2,
        )
        for unit, (factor, _) in ANGLES.items()
    ]


def _swings(recording: Recording, specimen: Specimen) -> dict[str, float]:
    """Return by how much the chamber that bends a section most does so over its range, as recorded.

    Sections are left out whose own chambers are not driven, or whose bends pressures do not explain.
    """
    chambers = recording.chambers
    pressures = np.column_stack(
        [np.zeros((len(recording.time), 0)), *(recording.pressure(k)[0] for k in chambers)]
    )
    read = np.isfinite(pressures).all(axis=1)
    if read.sum() < 20:
        return {}
    spans = np.ptp(np.percentile(pressures[read], [1.0, 99.0], axis=0), axis=0)
    driven = spans > DRIVEN * spans.max(initial=0.0)
    own = {
        specimen.section_below(segment.to_m) or ""
        for segment in specimen.segments
        for k, moved in zip(chambers, driven, strict=True)
        if moved and specimen.chambers[k].segment == segment.name
    }
    swings = {}
    for section in own & set(recording.bends):
        bend = recording.bend(section)
        seen = read & np.isfinite(bend).all(axis=1)
        if seen.sum() < 20:
            continue
        slopes = slopes_by_pressure(pressures[seen][:, driven] / spans[driven], bend[seen])
        if slopes is not None and slopes.any():
            swings[section] = float(np.linalg.norm(slopes, axis=1).max())
    return swings


def slopes_by_pressure(pressures: Floats, bends: Floats) -> Floats | None:
    """Regress bends on pressures, shape (chambers, columns); ``None`` where pressures leave too much of them.

    Args:
        pressures: Of the driven chambers, shape (samples, chambers).
        bends: Shape (samples, columns).
    """
    p, y = pressures - pressures.mean(axis=0), bends - bends.mean(axis=0)
    slopes, *_ = np.linalg.lstsq(p, y, rcond=ALIKE)
    shown = float(((y - p @ slopes) ** 2).sum()) <= SEEN * float((y**2).sum())
    return slopes if shown else None


def _tops(recording: Recording, sections: Sequence[str]) -> str:
    """State how far bends reach as recorded."""
    columns = {section: angle_columns([section]) for section in sections}
    tops = {
        s: max(float(np.nanmax(np.abs(recording.columns[n]))) for n in names) for s, names in columns.items()
    }
    return " and ".join(f"the bends of {section} reach {top:.4g}" for section, top in tops.items())


def angle_columns(sections: Sequence[str]) -> tuple[str, ...]:
    """List the columns of the bends of some sections."""
    return tuple(f"bend_{section}_{suffix}" for section in sections for suffix in BEND_SUFFIXES)


def in_radians(recording: Recording, sections: Sequence[str]) -> Recording:
    """Convert the bends of some sections from degrees."""
    names = angle_columns(sections)
    converted = {name: recording.columns[name] * ANGLES["degrees"][0] for name in names}
    return replace(recording, columns={**recording.columns, **converted})

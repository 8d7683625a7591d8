"""Channels of one recording whose names were exchanged: two pressures, or two bends."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.series import delayed
from softarm.estimator.specimen import Specimen
from softarm.estimator.statistics import unexplained_share

FOLLOWS = 0.9
"""Correlation from which a pressure follows a set-point."""
MOVED = 500.0
"""Spread of a pressure [Pa] from which it counts as moved."""
LAGS = np.arange(-2.5, 2.75, 0.25)
"""Lags of a bend behind the pressures [s] that are tried, since an exchanged sensor may be late besides."""
OTHER = 0.25
"""What another segment's chambers leave of a bend over what its own leave, below which it is the other's; the
same of a pressure and set-points."""


def refuse_swapped_channels(recording: Recording, specimen: Specimen) -> None:
    """Look for exchanged channels in a recording alone, without any model of the arm.

    A measured pressure follows its own set-point, and a segment is bent by its own chambers.

    Raises:
        InputError: Two channels look exchanged.
    """
    pair = _swapped_pressures(recording) or _swapped_bends(recording, specimen)
    if pair:
        raise refusal(recording.name, pair)


def _swapped_pressures(recording: Recording) -> str:
    names = [
        k
        for k in recording.chambers
        if {f"pressure_cmd_{k}_pa", f"pressure_{k}_pa"} <= set(recording.columns)
        and np.std(_observed(recording.columns[f"pressure_cmd_{k}_pa"])) > MOVED
    ]
    if len(names) < 2:
        return ""
    asked = recording.stack(tuple(f"pressure_cmd_{k}_pa" for k in names))
    given = recording.stack(tuple(f"pressure_{k}_pa" for k in names))
    observed = np.isfinite(asked).all(axis=1) & np.isfinite(given).all(axis=1)
    if observed.sum() < 10 * len(names):
        return ""
    follows = _correlation(given[observed], asked[observed])
    left = 1.0 - follows**2
    for a, b in combinations(range(len(names)), 2):
        crossed = min(follows[a, b], follows[b, a]) > FOLLOWS
        if crossed and left[a, b] < OTHER * left[a, a] and left[b, a] < OTHER * left[b, b]:
            return f"pressure_{names[a]}_pa and pressure_{names[b]}_pa"
    return ""


def _observed(column: Floats) -> Floats:
    """Keep what was read of a column; a zero where nothing was."""
    read = column[np.isfinite(column)]
    return read if len(read) else np.zeros(1)


def _correlation(one: Floats, other: Floats) -> Floats:
    """Correlate columns with columns, shape (columns, columns); what never changes follows nothing."""
    parts = [c - c.mean(axis=0) if len(c) else c for c in (one, other)]
    sizes = [np.maximum(np.linalg.norm(part, axis=0), 1e-9) for part in parts]
    correlation: Floats = (parts[0] / sizes[0]).T @ (parts[1] / sizes[1])
    return correlation


def _swapped_bends(recording: Recording, specimen: Specimen) -> str:
    """Compare how well the chambers of each segment explain each bend, by linear regression."""
    chambers: dict[str, list[int]] = {}
    for segment in specimen.segments:
        members = [chamber.index for chamber in specimen.chambers if chamber.segment == segment.name]
        chambers.setdefault(specimen.section_below(segment.to_m) or "", []).extend(members)
    present = set(recording.chambers)
    known = [name for name in recording.bends if chambers.get(name) and present >= {*chambers[name]}]
    for a, b in combinations(known, 2):
        if all(_is_of(recording, one, chambers[other], chambers[one]) for one, other in ((a, b), (b, a))):
            return f"bend_{a} and bend_{b}"
    return ""


def _is_of(recording: Recording, section: str, others: Sequence[int], own: Sequence[int]) -> bool:
    """Return whether other chambers explain a bend clearly better than its own do."""
    left = _unexplained(recording, section, others)
    # Its own leave no more than the whole: often one regression decides.
    return left < OTHER and left < OTHER * _unexplained(recording, section, own)


def _unexplained(recording: Recording, section: str, chambers: Sequence[int]) -> float:
    """Return the share of a bend's variance that some chambers' pressures leave at the best lag."""
    bend = recording.bend(section)
    pressures = np.column_stack([recording.pressure(k)[0] for k in chambers])
    if len(recording.time) < 2:
        return 1.0
    least = 10 * len(chambers)
    late = (delayed(recording.time, pressures, lag) for lag in LAGS)
    return min(unexplained_share(one, bend, least) for one in late)


def refusal(names: str, pair: str) -> InputError:
    """Refuse recordings in which two channels look exchanged."""
    return InputError(names, f"{pair} look exchanged", "exchange their columns, or check the wiring")

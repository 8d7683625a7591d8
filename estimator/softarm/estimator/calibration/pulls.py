"""Known forces on the arm: what a gauge pulls on a section, along its cord.

A recording states the section by ``gauge_section`` in its ``recording.toml`` or by the gauge's own name, and
the direction by a marker on the gauge's hook; a recording without such a marker states the direction itself,
by ``gauge_direction`` in the base frame.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.model import Load, loads_along
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import Registration
from softarm.estimator.series import LONGEST_BRIDGE, interpolate
from softarm.estimator.specimen import Specimen

# Name of the marker on a gauge's hook.
HOOK = "hook"
REPEATS = 8  # readings in a row that count as standing still
UNLIKE_OTHERS = 3.0  # times longer, or farther, than at any other level
LEAST_WAY = 1e-3  # m; less is noise
LEAST_PULL = 0.02  # N; less is a slack cord


def section_forces(specimen: Specimen) -> tuple[Load, ...]:
    """Return three forces on every rigid section that can move, ``<section>_x``, ``_y`` and ``_z``."""
    return tuple(
        load
        for section in specimen.sections
        if section.frame_origin_m[2] > specimen.clamp.up_to_m
        for load in loads_along(section.name, "xyz", section=section.name)
    )


def known_pulls(
    recording: Recording, specimen: Specimen, registration: Registration, loads: Sequence[Load]
) -> Floats:
    """Return the known forces on the sections [N], shape (samples, loads), ordered as by ``section_forces``.

    They are zero where no gauge pulls and NaN where its direction is unknown. Without loads, gauges are left
    out.

    Raises:
        InputError: A gauge's section is unknown, or it stood at the end of its range.
    """
    amplitudes = np.zeros((len(recording.time), len(loads)))
    if not loads:
        return amplitudes
    names = [str(load.section) for load in loads]
    for gauge in recording.gauges:
        tension = recording.gauge(gauge)
        if not np.nanmax(np.abs(tension), initial=0.0) > LEAST_PULL:
            continue
        section = gauged_section(recording, gauge, names)
        require_unsaturated(recording, gauge, section)
        direction = cord_direction(recording, specimen, registration, section)
        unknown = np.full((len(tension), 3), np.nan)
        if HOOK in recording.markers:
            tension = _held_until_release(recording, tension)
        slack = np.abs(tension) <= LEAST_PULL
        acting = tension[:, None] * (unknown if direction is None else direction)
        first = names.index(section)
        amplitudes[:, first : first + 3] += np.where(slack[:, None] & ~np.isfinite(acting), 0.0, acting)
    return amplitudes


def _held_until_release(recording: Recording, tension: Floats) -> Floats:
    """Return tensions in which the last reading before a cord is let go holds until then, shape (samples,).

    Such a cord does not slacken evenly from its last reading to the first one without it.
    """
    kept, time = tension.copy(), recording.time
    hooked = np.flatnonzero(np.isfinite(recording.marker(HOOK)).all(axis=1))
    silence = np.append(time[hooked[1:]], time[-1]) - time[hooked]
    for end in hooked[silence > LONGEST_BRIDGE] + 1:
        before = np.flatnonzero(np.isfinite(tension[:end]))
        if len(before):
            kept[before[-1] : end] = tension[before[-1]]
    return kept


def gauged_section(recording: Recording, gauge: str, sections: Sequence[str]) -> str:
    """Return which section a gauge pulls on.

    Raises:
        InputError: The recording does not state it, or names a section that the arm does not have.
    """
    named = recording.info.get("gauge_section", gauge)
    if named in sections:
        return str(named)
    if gauge in sections:
        return gauge
    listed = ", ".join(dict.fromkeys(sections))
    raise InputError(
        f"{recording.name}, gauge {gauge}",
        f"it is not known on which section it pulls (gauge_section is {named!r})",
        f"name one in recording.toml as gauge_section: {listed}",
    )


def cord_direction(
    recording: Recording, specimen: Specimen, registration: Registration, section: str
) -> Floats | None:
    """Return the unit vector from the knot to the hook in the base frame, shape (samples, 3).

    Zero where no hook is visible (the cord is off); ``None`` where the recording has no direction at all.
    """
    samples = len(recording.time)
    if HOOK in recording.markers:
        hook = registration.to_base(_bridged(recording, recording.marker(HOOK)))
        knot = np.broadcast_to(np.array(specimen.section(section).frame_origin_m), (samples, 3))
        if section in recording.frames:
            knot = registration.to_base(_bridged(recording, recording.pose(section)[:, :3]))
        reach = hook - knot
        lengths = np.linalg.norm(reach, axis=1, keepdims=True)
        tied = np.asarray(np.isfinite(hook).all(axis=1))
        return np.where(tied[:, None], reach / np.maximum(lengths, 1e-9), 0.0)
    stated = recording.info.get("gauge_direction")
    if stated is None:
        return None
    unit = np.array(stated, dtype=np.float64)
    return np.broadcast_to(unit / np.linalg.norm(unit), (samples, 3))


def _bridged(recording: Recording, places: Floats) -> Floats:
    """Return places at the times of the gauge as well, which reads in between, shape (samples, 3)."""
    time, observed = recording.time, np.isfinite(places).all(axis=1)
    if not observed.any():
        return places
    observed_rows = np.flatnonzero(observed)
    after = np.clip(np.searchsorted(observed_rows, np.arange(len(time))), 0, len(observed_rows) - 1)
    silence = time[observed_rows[after]] - time[observed_rows[np.maximum(after - 1, 0)]]
    bridged = np.column_stack([interpolate(time, time, column) for column in places.T])
    return np.where((observed | (silence <= LONGEST_BRIDGE))[:, None], bridged, np.nan)


def require_unsaturated(recording: Recording, gauge: str, section: str) -> None:
    """Refuse a gauge that stood at the end of its range, however seldom.

    Raises:
        InputError: Its largest reading repeats where it ought to change.
    """
    level, repeats = saturation(recording, gauge, section)
    if repeats:
        raise InputError(
            f"{recording.name}, gauge {gauge}",
            f"saturated gauge: it stood at {level:.3g} N for {repeats} readings, the end of its range",
            "pull less, or with a larger gauge",
        )


def saturation(recording: Recording, gauge: str, section: str) -> tuple[float, int]:
    """Find a gauge's largest reading, and how often it repeated at the end of the range.

    Readings repeat in rests as well, where their steps are coarser than their noise. At the end of the range
    they repeat far longer than at any other level, or while arm and hook move farther than at any other.

    Returns:
        Largest reading [N], and its repeats in a row; 0 where the range did not end.
    """
    pull = np.abs(recording.gauge(gauge))
    observed = np.flatnonzero(np.isfinite(pull))
    values = pull[observed]
    top = float(values.max(initial=0.0))
    # Hardly a pull, or an even one such as a hanging weight: there repeats show nothing of the range.
    if top < 10 * LEAST_PULL or np.ptp(values) <= 0.5 * top:
        return top, 0
    apart = np.diff(recording.time[observed], prepend=-np.inf, append=np.inf) > LONGEST_BRIDGE
    edges = np.flatnonzero(apart | (np.diff(values, prepend=np.nan, append=np.nan) != 0.0))
    lengths, levels = np.diff(edges), values[edges[:-1]]
    longest = int(lengths[levels == top].max())
    if longest < REPEATS:
        return top, 0
    if longest > UNLIKE_OTHERS * lengths[levels < top].max():
        return top, longest
    runs = [slice(observed[first], observed[last - 1] + 1) for first, last in pairwise(edges)]
    ways = np.array([_way(recording, section, run) for run in runs])
    usual = ways[(levels < top) & (levels > LEAST_PULL)].max(initial=LEAST_WAY)
    return top, longest if ways[levels == top].max() > UNLIKE_OTHERS * usual else 0


def _way(recording: Recording, section: str, during: slice) -> float:
    """Return how far hook or section moves meanwhile along any axis [m]."""
    places = [recording.marker(HOOK)] if HOOK in recording.markers else []
    places += [recording.pose(section)[:, :3]] if section in recording.frames else []
    parts = [place[during] for place in places]
    observed = [part[np.isfinite(part).all(axis=1)] for part in parts]
    return max((float(np.ptp(part, axis=0).max()) for part in observed if len(part)), default=0.0)

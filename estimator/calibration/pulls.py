"""Known forces on the arm: what a gauge pulls on a section, along its cord.

A recording tells the section by ``gauge_section`` in its ``recording.toml`` or by the gauge's own name, and
the direction by a marker on the gauge's hook; a recording without such a marker names the direction itself,
by ``gauge_direction`` in the base frame.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.model import Load
from estimator.recording import Recording
from estimator.sensing import Registration
from estimator.specimen import Specimen

Floats = NDArray[np.float64]

HOOK = "hook"
SATURATED_REPEATS = 25
SATURATION_SHARE = 0.995
LEAST_PULL = 0.02  # N; less is a slack cord


def section_forces(specimen: Specimen) -> tuple[Load, ...]:
    """Give three forces on every rigid section that can move, ``<section>_x``, ``_y`` and ``_z``."""
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    return tuple(
        Load(f"{section.name}_{axis}", "force", direction, section=section.name)
        for section in specimen.sections
        if section.frame_origin_m[2] > specimen.clamp.up_to_m
        for axis, direction in axes.items()
    )


def known_pulls(
    recording: Recording, specimen: Specimen, registration: Registration, loads: Sequence[Load]
) -> Floats:
    """Give the amplitudes of the loads that a recording's gauges tell, NaN between their readings.

    Args:
        recording: What was recorded.
        specimen: The robot.
        registration: Laboratory to base.
        loads: Three forces a section, as ``section_forces`` gives them; none leaves all gauges out.

    Returns:
        Amplitudes [N], zero where no gauge pulls, NaN where it is not known where to, shape
        (samples, loads).

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
        require_unsaturated(recording, gauge)
        direction = cord_direction(recording, specimen, registration, section)
        unknown = np.full((len(tension), 3), np.nan)
        slack = np.abs(tension) <= LEAST_PULL
        acting = tension[:, None] * (unknown if direction is None else direction)
        first = names.index(section)
        amplitudes[:, first : first + 3] += np.where(slack[:, None] & ~np.isfinite(acting), 0.0, acting)
    return amplitudes


def gauged_section(recording: Recording, gauge: str, sections: Sequence[str]) -> str:
    """Tell which section a gauge pulls on.

    Raises:
        InputError: The recording does not say, or names a section that the arm does not have.
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
    """Give the unit vector from the knot to the hook in the base frame, shape (samples, 3).

    Zero where no hook is seen (the cord is off); ``None`` where the recording knows of none at all.
    """
    samples = len(recording.time)
    if HOOK in recording.markers:
        hook = registration.to_base(recording.marker(HOOK))
        knot = np.broadcast_to(np.array(specimen.section(section).frame_origin_m), (samples, 3))
        if section in recording.frames:
            knot = registration.to_base(recording.pose(section)[:, :3])
        reach = hook - knot
        lengths = np.linalg.norm(reach, axis=1, keepdims=True)
        tied = np.asarray(np.isfinite(hook).all(axis=1))
        return np.where(tied[:, None], reach / np.maximum(lengths, 1e-9), 0.0)
    told = recording.info.get("gauge_direction")
    if told is None:
        return None
    unit = np.array(told, dtype=np.float64)
    return np.broadcast_to(unit / np.linalg.norm(unit), (samples, 3))


def require_unsaturated(recording: Recording, gauge: str) -> None:
    """Refuse a gauge that stood at the end of its range.

    Raises:
        InputError: Its largest reading repeats for long while it pulls.
    """
    tension = recording.gauge(gauge)
    seen = tension[np.isfinite(tension)]
    if len(seen) < 2 * SATURATED_REPEATS or seen.max() < 10 * LEAST_PULL:
        return
    top = np.asarray(seen == seen.max())
    runs = np.diff(np.flatnonzero(np.concatenate([[True], ~top, [True]]))) - 1
    moving = np.ptp(seen[~top]) > 0.5 * seen.max() if (~top).any() else False
    if moving and runs.max() >= SATURATED_REPEATS and (seen > SATURATION_SHARE * seen.max()).mean() > 0.1:
        raise InputError(
            f"{recording.name}, gauge {gauge}",
            f"it stood at {seen.max():.3g} N for {runs.max()} readings: the end of its range",
            "pull less, or with a larger gauge",
        )

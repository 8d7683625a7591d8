"""Recordings without the base: whether positions can be in the base frame at all.

The base's frame or markers register the laboratory. Without them positions count as given in the base
frame, and that can be checked: with low pressures each section is near its rest, and a chamber bends the
arm away from its azimuth, a_k = -exp(i phi_k). With s_k the regression of the lateral place on pressure k,
as a complex number, the laboratory is rotated about the arm's axis by arg(sum s_k conj(a_k)); where it is
mirrored, sum s_k a_k is larger.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Chamber, Specimen

LOWEST = 10.0
"""Percentile of the summed pressures up to which the arm counts as at rest."""
AWAY, TILT = 0.35, np.radians(40.0)
"""Distance over height, and tilt, by which a section may lie off its rest: arms held sideways droop."""
RESTING = 0.2
"""Share of the limits up to which the lowest pressures leave the arm near its rest."""
BENT = 3.0
"""Where they do not, sections may lie so many times farther off."""
TURN = np.radians(25.0)
"""Rotation about the arm's axis from which the laboratory counts as rotated."""
CLEAR = 0.7
"""Share of the chambers' slopes that one rotation must explain."""
MIRRORED = 1.2
"""So many times better a mirrored frame must explain them: one chamber alone fits either."""
LEAST_SAMPLES = 20
CALM = "with the lowest pressures"
NOTHING = ", and nothing of the base was recorded"


@dataclass(frozen=True)
class LooseBody:
    """A frame or a marker below the base.

    Args:
        name: What a message calls it.
        above: From where on it is moved: the upper end of its section along the arm [m].
        rest: Where it is at rest in the base frame [m], shape (3,).
        place: Where it was recorded [m], shape (samples, 3).
    """

    name: str
    above: float
    rest: Floats
    place: Floats


def check_mount(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Refuse positions that are not in the base frame where nothing of the base was recorded."""
    base = specimen.sections[0].name
    recorded = {marker.section for marker in specimen.markers if marker.name in recording.markers}
    if base in recorded or base in recording.frames:
        return recording, ()
    bodies = _bodies(recording, specimen)
    words = (
        _off_rest(recording, specimen, bodies)
        or _tilted(recording, specimen)
        or _turned(recording, specimen, bodies)
    )
    if not words:
        return recording, ()
    cure = f"record the frame or three markers of the {base}, or give all positions in its frame"
    names = tuple(body.name for body in bodies)
    return recording, (RecordingFault(recording.name, "frame", names, words + NOTHING, cure, mended=False),)


def _bodies(recording: Recording, specimen: Specimen) -> list[LooseBody]:
    bodies = []
    for section in specimen.sections:
        origin, rest = np.array(section.frame_origin_m), from_quaternions(np.array(section.frame_quaternion))
        if section.name in recording.frames:
            place = recording.pose(section.name)[:, :3]
            bodies.append(LooseBody(f"frame_{section.name}", section.from_m, origin, place))
        for marker in specimen.markers:
            if marker.section == section.name and marker.name in recording.markers:
                own = origin + rest @ np.array(marker.offset_m)
                bodies.append(
                    LooseBody(f"marker_{marker.name}", section.from_m, own, recording.marker(marker.name))
                )
    return bodies


def _off_rest(recording: Recording, specimen: Specimen, bodies: list[LooseBody]) -> str:
    """Name the body that lies far off its rest with low pressures; empty where none does."""
    calm, most = _calm(recording, specimen)
    for body in bodies:
        own = body.place[calm & np.isfinite(body.place).all(axis=1)]
        away = float(np.linalg.norm(np.median(own, axis=0) - body.rest)) if len(own) else 0.0
        if away > most * AWAY * specimen.length_m:
            return f"{body.name} lies {1e3 * away:.0f} mm off its rest in the base frame {CALM}"
    return ""


def _tilted(recording: Recording, specimen: Specimen) -> str:
    """Name the frame that is tilted against its rest with low pressures; empty where none is."""
    calm, most = _calm(recording, specimen)
    for section in (one for one in specimen.sections if one.name in recording.frames):
        own = recording.pose(section.name)[calm]
        axes = from_quaternions(own[np.isfinite(own).all(axis=1), 3:])[:, :, 2]
        rest = from_quaternions(np.array(section.frame_quaternion))[:, 2]
        tilt = float(np.median(np.arccos(np.clip(axes @ rest, -1.0, 1.0)))) if len(axes) else 0.0
        if tilt > most * TILT:
            return f"frame_{section.name} is tilted by {np.degrees(tilt):.0f} degrees against its rest {CALM}"
    return ""


def _calm(recording: Recording, specimen: Specimen) -> tuple[NDArray[np.bool_], float]:
    """Find the samples with the lowest pressures, shape (samples,), and by what factor these bend the arm."""
    total = np.zeros(len(recording.time))
    for chamber in recording.chambers:
        total += np.nan_to_num(recording.pressure(chamber)[0])
    lowest = float(np.percentile(total, LOWEST))
    calm: NDArray[np.bool_] = total <= lowest
    return calm, 1.0 if lowest <= RESTING * sum(specimen.pressure_limits) else BENT


def _turned(recording: Recording, specimen: Specimen, bodies: list[LooseBody]) -> str:
    """State by how much the directions in which pressures bend the arm are rotated, if they are."""
    chambers = [chamber for chamber in specimen.chambers if chamber.index in recording.chambers]
    plain, mirrored, power = 0.0j, 0.0j, 0.0
    for body in bodies:
        for chamber, slope in zip(chambers, _slopes(recording, chambers, body), strict=True):
            if specimen.segment(chamber.segment).from_m < body.above:
                expected = -np.exp(1j * chamber.azimuth_rad)
                plain += slope * np.conj(expected)
                mirrored += slope * expected
                power += abs(slope)
    if power == 0.0 or max(abs(plain), abs(mirrored)) < CLEAR * power:
        return ""
    if abs(mirrored) > MIRRORED * abs(plain):
        return "pressures bend the arm as in a mirrored frame"
    rotation = float(np.angle(plain))
    if abs(rotation) < TURN:
        return ""
    return (
        f"pressures bend the arm in directions rotated by {np.degrees(rotation):.0f} degrees about its axis"
    )


def _slopes(recording: Recording, chambers: list[Chamber], body: LooseBody) -> NDArray[np.complex128]:
    """Regress the lateral place, x + i y, on the pressures, shape (chambers,)."""
    pressures = np.column_stack(
        [np.zeros((len(recording.time), 0)), *(recording.pressure(c.index)[0] for c in chambers)]
    )
    valid = np.isfinite(pressures).all(axis=1) & np.isfinite(body.place).all(axis=1)
    if valid.sum() < LEAST_SAMPLES:
        return np.zeros(len(chambers), dtype=np.complex128)
    inputs, place = (
        pressures[valid] - pressures[valid].mean(axis=0),
        body.place[valid, 0] + 1j * body.place[valid, 1],
    )
    slopes, *_ = np.linalg.lstsq(inputs, place - place.mean(), rcond=1e-3)
    return np.asarray(slopes, dtype=np.complex128)

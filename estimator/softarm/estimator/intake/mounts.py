"""Whether positions are in the base frame, and whether the base's own frame is that of the specimen.

The base's frame or markers register the laboratory. Without them positions count as given in the base
frame, and that can be checked: with low pressures each section is near its rest, and chambers bend the arm
away from their azimuths (``bending``). The latter holds behind a registration too: a body of the base that is
rotated about its axis, or a laboratory whose positions and orientations are both left-handed, contradict
nothing else.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.calibration.arrange import registration_of
from softarm.estimator.errors import InputError
from softarm.estimator.intake.bending import BendingDirections, LooseBody, bending_directions
from softarm.estimator.intake.mirrors import shown_by_markers
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Specimen

LOWEST = 10.0
"""Percentile of the summed pressures up to which the arm counts as at rest."""
AWAY, TILT = 0.35, np.radians(40.0)
"""Distance over height, and tilt, by which a section may lie off its rest: arms held sideways droop."""
RESTING = 0.2
"""Share of the limits up to which the lowest pressures leave the arm near its rest."""
BENT = 3.0
"""Where they do not, sections may lie so many times farther off."""
CALM = "with the lowest pressures"
NOTHING = ", and nothing of the base was read"


def check_mount(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Refuse positions that are not in the base frame, and a base frame that is not the specimen's."""
    base = specimen.sections[0].name
    if _seen(recording, specimen, base):
        return recording, _against_base(recording, specimen)
    bodies = bodies_of(recording, specimen)
    words = (
        _off_rest(recording, specimen, bodies)
        or _tilted(recording, specimen)
        or _rotated(recording, specimen, bodies)
    )
    if not words:
        return recording, ()
    known = {marker.name for marker in specimen.markers}
    unknown = [name for name in recording.markers if name not in known]
    cure = (
        f"describe the markers of the {base} in the specimen, if some of {', '.join(unknown)} are on it"
        if unknown
        else f"record the frame or three markers of the {base}, or give all positions in its frame"
    )
    names = tuple(body.name for body in bodies)
    return recording, (
        RecordingFault(recording.name, "frame", names, words + NOTHING, cure, corrected=False),
    )


def _seen(recording: Recording, specimen: Specimen, base: str) -> bool:
    """Whether the frame or a marker of the base was read at any time."""
    framed = base in recording.frames and bool(np.isfinite(recording.pose(base)).all(axis=1).any())
    return framed or bool(_base_markers(recording, specimen))


def _base_markers(recording: Recording, specimen: Specimen) -> list[str]:
    """List the markers of the base that were read at any time."""
    named = [m.name for m in specimen.markers if m.section == specimen.sections[0].name]
    present = [name for name in named if name in recording.markers]
    return [name for name in present if np.isfinite(recording.marker(name)).all(axis=1).any()]


def _against_base(recording: Recording, specimen: Specimen) -> tuple[RecordingFault, ...]:
    """State how the base's frame, by which the laboratory is registered, differs from the specimen's."""
    found = registered_directions(recording, specimen)
    if found is None or not (found.is_mirrored or found.is_rotated):
        return ()
    by_markers = len(_base_markers(recording, specimen)) >= 3
    words = _directions(found, handed=by_markers) + ", as the base registers it"
    cure = (
        "export a right-handed laboratory, or number the chambers as the specimen does"
        if found.is_mirrored
        else "number the chambers as the specimen does, or name the base's markers as it does"
        if by_markers
        else "rotate the axes of the base's body to those of the specimen, or number the chambers as it does"
    )
    names = tuple(body.name for body in bodies_of(recording, specimen))
    return (RecordingFault(recording.name, "frame", names, words, cure, corrected=False),)


def registered_directions(recording: Recording, specimen: Specimen) -> BendingDirections | None:
    """Find in which directions pressures bend the arm in the frame of its recorded base."""
    try:
        registration = registration_of(recording, specimen, specimen.sections[0].name)
    except InputError:  # refused with these words where the recording is arranged
        return None
    bodies = [
        replace(body, place=registration.to_base(body.place)) for body in bodies_of(recording, specimen)
    ]
    return bending_directions(recording, specimen, bodies)


def only_agreeing(recordings: Sequence[Recording], specimen: Specimen) -> int | None:
    """Return which one of several corrected recordings markers or pressures agree with, if one alone.

    Its markers fit its frames, or chambers bend the arm away from their azimuths.
    """
    best = shown_by_markers(recordings, specimen)
    if best is not None:
        return best
    found = [registered_directions(one, specimen) for one in recordings]
    if any(one is None or not one.is_decided for one in found):
        return None
    agreeing = [k for k, one in enumerate(found) if one is not None and one.as_specimen]
    return agreeing[0] if len(agreeing) == 1 else None


def bodies_of(recording: Recording, specimen: Specimen) -> list[LooseBody]:
    """List the frames and markers of a recording that belong to the specimen."""
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
            return f"{body.name} lies {1e3 * away:.0f} mm from its rest position in the base frame {CALM}"
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
            size = f"{np.degrees(tilt):.0f} degrees"
            return f"frame_{section.name} is tilted by {size} from its rest orientation {CALM}"
    return ""


def _calm(recording: Recording, specimen: Specimen) -> tuple[NDArray[np.bool_], float]:
    """Find the samples with the lowest pressures, shape (samples,), and by what factor these bend the arm."""
    total = np.zeros(len(recording.time))
    for chamber in recording.chambers:
        total += np.nan_to_num(recording.pressure(chamber)[0])
    lowest = float(np.percentile(total, LOWEST))
    calm: NDArray[np.bool_] = total <= lowest
    return calm, 1.0 if lowest <= RESTING * sum(specimen.pressure_limits) else BENT


def _rotated(recording: Recording, specimen: Specimen, bodies: list[LooseBody]) -> str:
    """State by how much the directions in which pressures bend the arm are rotated, if they are."""
    found = bending_directions(recording, specimen, bodies)
    return "" if found is None else _directions(found, handed=False)


def _directions(found: BendingDirections, *, handed: bool) -> str:
    """State how the directions in which pressures bend the arm differ from the specimen's; empty if not.

    Args:
        found: The directions.
        handed: Whether something else shows that the laboratory is not mirrored: three markers of the base
            fit their places in a mirrored laboratory only with the arm on the wrong side of them.
    """
    if found.is_mirrored:
        return "pressures bend the arm as in a mirrored frame"
    if found.is_rotated:
        angle = np.degrees(found.rotation)
        return f"pressures bend the arm in directions rotated by {angle:.0f} degrees about its axis" + (
            "" if handed or found.is_handed else ", or the laboratory is mirrored"
        )
    return ""

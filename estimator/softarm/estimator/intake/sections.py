"""Frames of sections: exchanged, mirrored, rotated on their bodies, or with quaternions in another order.

Positions must follow from orientations: between two sections an arm of length L runs along the mean of
their axes,
p_2 - p_1 = L (R_1 e_z + R_2 e_z) / 2 up to a tenth of L, however it bends. A rotation of the whole
laboratory keeps that; the base's frame registers it. A mirror M of positions alone does not keep it. With the
orientations M R M it does, up to the sign of all axes where M mirrors z: the same as bodies that are all
upside down, from which the markers or the pressures distinguish it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations, product

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.hypotheses import UNAMBIGUOUS, Explanation, choose
from softarm.estimator.intake.mirrors import (
    AXES,
    clearly_least,
    marker_distance,
    mirror_frames,
    mirror_markers,
    shown_by_markers,
)
from softarm.estimator.intake.mounts import only_agreeing, registered_directions
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import BEND_SUFFIXES, POSE_SUFFIXES, Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Specimen

CHORD, VARYING = 0.1, 0.03
"""Error of a chord over the arm's length, constant and varying: bodies sit off the axis, and no section
bends as a circle."""
EXCHANGED = -4.0
"""Logarithm of the prior per exchanged name."""
REORIENTED = -5.0
"""And of a mirrored axis, of quaternions in another order, or of a base whose body points elsewhere."""
WRONG_BEND = np.radians(2.0)
"""Bends this near to the frames' tilts are those of their sections."""
ALIKE = 0.3
"""Share of that difference that an exchange may leave."""
SAMPLES = 60
MISFIT, CORRECTED = 1.5, 1.1
"""Chords that the best explanation misses by so many times ``CHORD`` are no arm of this specimen; from the
second on no explanation is good enough to correct by. Of 400 simulated recordings of SoPrA, hanging and held
sideways, with up to two faults of the arm, half miss by 0.24 or less, 99 % by 0.57 and all by 0.87."""
SCALAR_FIRST = [3, 0, 1, 2]
"""Where w, x, y and z stand in a quaternion (x, y, z, w)."""
UPSIDE_DOWN = "the z axes of all bodies point from the tip to the base"


@dataclass(frozen=True)
class SensorChannels:
    """One explanation of the recorded frames.

    Args:
        labels: Recorded frame of each section.
        mirrored: Mirrored axis of the positions.
        axis: Axis of the base's body that points along the arm,
        sign: and its sign.
        reversed: Whether the z axes of all bodies point from the tip to the base.
        scalar_last: Whether quaternions were written as (x, y, z, w).
    """

    labels: tuple[int, ...]
    mirrored: int | None = None
    axis: int = 2
    sign: float = 1.0
    reversed: bool = False
    scalar_last: bool = False


def correct_sections(
    recording: Recording, specimen: Specimen, mirrored: int | None = None
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Find exchanged sections and mirrored or rotated frames, and correct them where one explanation wins.

    Args:
        recording: The recording.
        specimen: The robot.
        mirrored: Axis of the laboratory that is mirrored in other recordings of it: here as well, unless this
            recording shows otherwise.
    """
    names = [section.name for section in specimen.sections if section.name in recording.frames]
    if len(names) < 2 or names[0] != specimen.sections[0].name:
        return recording, ()
    poses = _samples(recording, names)
    if len(poses) < 2:
        return recording, ()
    heights = np.array([specimen.section(name).frame_origin_m[2] for name in names])
    rotations = [from_quaternions(poses[:, k, 3:]) for k in range(len(names))]
    tried = [
        Explanation(setup, _prior(setup, mirrored) - 0.5 * _squares(poses, rotations, heights, setup))
        for setup in _setups(len(names))
    ]
    choice = choose(tried)
    best = choice.best.what
    off = _distance(poses, rotations, heights, best)
    plain = best == _setups(len(names))[0]
    if off > (MISFIT if plain else CORRECTED) * CHORD * heights[-1]:
        what = f"positions and orientations of {', '.join(names)} contradict each other by {1e3 * off:.0f} mm"
        cure = "check the order of the quaternion (w, x, y, z), the axes of the bodies, and the specimen"
        return recording, (
            RecordingFault(recording.name, "frame", tuple(names), what, cure, corrected=False),
        )
    if plain:
        return recording, ()
    rivals = [
        one.what for one in tried if one.log_likelihood > choice.best.log_likelihood - np.log(UNAMBIGUOUS)
    ]
    shown = best if choice.unambiguous else _shown(recording, specimen, names, rivals)
    best = shown or best
    words = _describe(names, best)
    columns = tuple(f"frame_{name}" for name in names)
    if best.axis != 2 or best.sign < 0.0:
        cure = "define the body so that its z points along the arm; its rotation about z cannot be determined"
        return recording, (
            RecordingFault(recording.name, "frame", columns[:1], words, cure, False, choice.odds),
        )
    if shown is not None and shown.reversed:
        return _whole_mirror(recording, specimen, columns)
    if shown is None:
        what = f"{words}, or {_describe(names, choice.second.what)}"
        cure = f"correct the export (odds only {choice.odds:.0f})"
        return recording, (RecordingFault(recording.name, "frame", columns, what, cure, False, choice.odds),)
    corrected, follow = _corrected(recording, specimen, names, best)
    if follow is None:
        what = f"{words}, and the markers fit the frames neither with that axis mirrored nor without"
        cure = "export frames and markers in one right-handed laboratory"
        return recording, (RecordingFault(recording.name, "frame", columns, what, cure, False, choice.odds),)
    off, before = (_distance(poses, rotations, heights, setup) for setup in (best, tried[0].what))
    fits = f"positions follow from orientations to {1e3 * off:.0f} instead of {1e3 * before:.0f} mm"
    alike = " as in other recordings" if mirrored is not None and best.mirrored == mirrored else ""
    what = f"{words}{alike}{follow}: {fits}"
    mismatch = RecordingFault(
        recording.name,
        "frame",
        columns,
        what,
        "corrected for this run",
        odds=choice.odds,
        mirrored=best.mirrored,
    )
    return corrected, (mismatch,)


def correct_bends(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Exchange bends that belong to each other's section, where frames show the tilts as well."""
    order = [section.name for section in specimen.sections]
    tilts = {}
    for above, below in pairwise(order):
        if {above, below} <= set(recording.frames) and below in recording.bends:
            one, other = (from_quaternions(recording.pose(name)[:, 3:])[:, :, 2] for name in (above, below))
            tilts[below] = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
    names = tuple(tilts)
    sizes = {name: np.linalg.norm(recording.bend(name), axis=1) for name in names}
    if len(names) < 2 or not np.isfinite([*sizes.values(), *tilts.values()]).all(axis=0).any():
        return recording, ()
    off = {
        labels: max(
            float(np.nanmedian(np.abs(sizes[a] - tilts[b]))) for a, b in zip(labels, names, strict=True)
        )
        for labels in permutations(names)
    }
    best = min(off, key=lambda labels: off[labels])
    if best == names or off[names] < WRONG_BEND or off[best] > ALIKE * off[names]:
        return recording, ()
    columns = dict(recording.columns)
    for label, name in zip(best, names, strict=True):
        for suffix in BEND_SUFFIXES:
            columns[f"bend_{name}_{suffix}"] = recording.columns[f"bend_{label}_{suffix}"]
    far, near = (np.degrees(off[labels]) for labels in (names, best))
    fits = f"they fit the frames to {near:.1f} instead of {far:.1f} degrees"
    what = f"bends of {' and '.join(names)} are exchanged: {fits}"
    streams = tuple(f"bend_{name}" for name in names)
    return replace(recording, columns=columns), (
        RecordingFault(recording.name, "labels", streams, what, "corrected for this run"),
    )


def _setups(count: int) -> list[SensorChannels]:
    """List the explanations, the recording as it is first."""
    orders = list(permutations(range(count)))
    mirrors: tuple[int | None, ...] = (None, 0, 1, 2)
    plain = [SensorChannels(labels, mirrored) for labels, mirrored in product(orders, mirrors)]
    others = ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, -1.0))
    based = (SensorChannels(orders[0], None, axis, sign) for axis, sign in others)
    written = (SensorChannels(orders[0], reversed=True), SensorChannels(orders[0], scalar_last=True))
    return [*plain, *based, *written]


def _prior(setup: SensorChannels, mirrored: int | None) -> float:
    """Return the logarithm of an explanation's prior where other recordings show an axis to be mirrored."""
    moved = sum(label != k for k, label in enumerate(setup.labels))
    reoriented = setup.axis != 2 or setup.sign < 0.0 or setup.reversed or setup.scalar_last
    return EXCHANGED * 0.5 * moved + REORIENTED * (setup.mirrored != mirrored) + REORIENTED * reoriented


def _squares(poses: Floats, rotations: Sequence[Floats], heights: Floats, setup: SensorChannels) -> float:
    """Compute squared errors of all chords and of a base that stays where it is, in their deviations."""
    base = poses[:, setup.labels[0], :3]
    moved = float(((base - base.mean(axis=0)) ** 2).sum(axis=1).mean()) / (VARYING * heights[-1]) ** 2
    errors = _chord_errors(poses, rotations, heights, setup)
    middle = errors.mean(axis=0)
    constant = float((middle**2).sum()) / (CHORD * heights[-1]) ** 2
    varying = float(((errors - middle) ** 2).sum(axis=(1, 2)).mean()) / (VARYING * heights[-1]) ** 2
    return float(constant + varying + moved)


def _distance(poses: Floats, rotations: Sequence[Floats], heights: Floats, setup: SensorChannels) -> float:
    """Compute the rms error of a chord [m]."""
    errors = _chord_errors(poses, rotations, heights, setup)
    return float(np.sqrt((errors**2).sum(axis=2).mean()))


def _chord_errors(
    poses: Floats, rotations: Sequence[Floats], heights: Floats, setup: SensorChannels
) -> Floats:
    """Compute measured minus expected chords [m], shape (samples, chords, 3)."""
    mirror = np.ones(3)
    if setup.mirrored is not None:
        mirror[setup.mirrored] = -1.0
    places = poses[:, list(setup.labels), :3] * mirror
    if setup.scalar_last:
        rotations = [from_quaternions(poses[:, k, 3:][:, SCALAR_FIRST]) for k in range(len(rotations))]
    axes = [rotations[k][:, :, 2] for k in setup.labels]
    axes[0] = setup.sign * rotations[setup.labels[0]][:, :, setup.axis]
    along = -1.0 if setup.reversed else 1.0
    steps = [
        along * 0.5 * (upper - lower) * (one + other)
        for lower, upper, one, other in zip(heights, heights[1:], axes, axes[1:], strict=False)
    ]
    errors: Floats = np.diff(places, axis=1) - np.stack(steps, axis=1)
    return errors


def _samples(recording: Recording, names: Sequence[str]) -> Floats:
    poses = np.stack([recording.pose(name) for name in names], axis=1)
    valid = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
    if not len(valid):
        return poses[:0]
    chosen: Floats = poses[valid[np.unique(np.linspace(0, len(valid) - 1, SAMPLES).astype(int))]]
    return chosen


def _describe(names: Sequence[str], setup: SensorChannels) -> str:
    words = []
    moved = [k for k, label in enumerate(setup.labels) if label != k]
    if len(moved) == 2:
        words.append(f"frames {names[moved[0]]} and {names[moved[1]]} are exchanged")
    elif moved:
        listed = ", ".join(f"{names[setup.labels[k]]} is named {names[k]}" for k in moved)
        words.append(f"frames are permuted ({listed})")
    if setup.mirrored is not None:
        words.append(f"the {AXES[setup.mirrored]} axis of the laboratory's positions is mirrored")
    if setup.axis != 2 or setup.sign < 0.0:
        words.append(
            f"the base's body has its {'-' if setup.sign < 0 else ''}{AXES[setup.axis]} axis along the arm"
        )
    if setup.reversed:
        words.append(UPSIDE_DOWN)
    if setup.scalar_last:
        words.append("the quaternions are in the order x, y, z, w, and not w, x, y, z")
    return " and ".join(words) or "the frames as they are named"


def _shown(
    recording: Recording, specimen: Specimen, names: Sequence[str], rivals: Sequence[SensorChannels]
) -> SensorChannels | None:
    """Return the only one of some explanations that markers or pressures agree with."""
    if any(setup.axis != 2 or setup.sign < 0.0 for setup in rivals):  # such a body may be rotated about z
        return None
    corrected = [_corrected(recording, specimen, names, setup)[0] for setup in rivals]
    shown = only_agreeing(corrected, specimen)
    return None if shown is None else rivals[shown]


def _whole_mirror(
    recording: Recording, specimen: Specimen, columns: tuple[str, ...]
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Mirror positions and orientations along z where markers or pressures show a left-handed laboratory."""
    alone = mirror_frames(recording, 2, whole=True)
    together = mirror_markers(alone, 2)
    best = shown_by_markers((alone, together), specimen)
    found = registered_directions(together, specimen)
    if best == 1 or (best is None and found is not None and found.as_specimen):
        shown = "the markers" if best == 1 else "the pressures"
        what = f"the z axis of the laboratory is mirrored, in positions and orientations, as {shown} show"
        return together, (RecordingFault(recording.name, "frame", columns, what, "corrected for this run"),)
    what = f"{UPSIDE_DOWN}, or the laboratory is left-handed"
    cure = "export a right-handed laboratory, and define the bodies so that their z points along the arm"
    return recording, (RecordingFault(recording.name, "frame", columns, what, cure, corrected=False),)


def _corrected(
    recording: Recording, specimen: Specimen, names: Sequence[str], setup: SensorChannels
) -> tuple[Recording, str | None]:
    """Correct the frames, and the markers where they share the mirrored axis; describe the markers."""
    columns = dict(recording.columns)
    for k, label in enumerate(setup.labels):
        for suffix in POSE_SUFFIXES:
            columns[f"frame_{names[k]}_{suffix}"] = recording.columns[f"frame_{names[label]}_{suffix}"]
    if setup.scalar_last:
        for name in names:
            pose = recording.pose(name)[:, 3:][:, SCALAR_FIRST]
            columns |= {f"frame_{name}_q{letter}": pose[:, k] for k, letter in enumerate("wxyz")}
    corrected = replace(recording, columns=columns)
    if setup.mirrored is None and not setup.reversed:
        return corrected, ""
    axis = 2 if setup.mirrored is None else setup.mirrored
    alone = mirror_frames(corrected, axis, whole=setup.reversed)
    together = mirror_markers(alone, axis)
    distances = np.array([marker_distance(one, specimen) for one in (alone, together)])
    if np.isnan(distances).all():
        return together, ""
    best = clearly_least(distances)
    if best is None:
        return recording, None
    return (together, "") if best else (alone, ", and that of the markers is not")

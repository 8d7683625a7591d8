"""Labels of markers and handedness of their laboratory, by trying them against the specimen's rigid sections.

A labelling is judged by how rigidly the markers of each section fit their places in the specimen, and by
where it puts the sections in the base frame: near to their rest. Markers that lie almost in one plane fit it
either way round, so an exchange of two is a mirrored laboratory with an exchange elsewhere. Which of these
explanations it is, frames decide, or the directions in which pressures bend the arm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations, product

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.hypotheses import UNAMBIGUOUS, Explanation, choose
from softarm.estimator.intake.mirrors import (
    AXES,
    mirror_frames,
    mirror_markers,
    shown_by_markers,
)
from softarm.estimator.intake.mounts import only_agreeing
from softarm.estimator.intake.result import Kind, RecordingFault
from softarm.estimator.recording import MARKER_SUFFIXES, Recording
from softarm.estimator.rotations import from_quaternions, log, nearest_rotation
from softarm.estimator.specimen import Specimen

Labels = tuple[int, ...]
Fit = tuple[Floats, Floats, Floats]
"""Rotations and origins of a section, and distances of its markers from their places."""

PLACED = 3e-3
"""Standard deviation of a marker's place in its section [m]: nominal places are 2 to 5 mm off."""
REACH = 0.35
"""Standard deviation of a section's place over its height, between rest and any pose."""
TILT = 0.5
"""And of its orientation [rad]."""
MOVED = -3.0
"""Logarithm of the prior per marker with a wrong name."""
MIRRORED = -5.0
"""Logarithm of the prior of a laboratory frame with a mirrored axis."""
DOUBTED = 8.0
"""Explanations that are less probable by the exponential of this, 3000 times, before the markers are seen
need not be refuted: two more markers with wrong names are not as rare."""
WHOLE = 5
"""Up to so many markers, every labelling is tried; above, exchanges within and between sections."""
MISFIT = 8.0
"""A marker that is so many standard deviations off its place is not that marker."""
FRAMES = 9
"""Samples that a labelling is judged by: by their median, since a start or a touch shifts a few of them."""


@dataclass(frozen=True)
class MarkerLayout:
    """Markers of the specimen that a recording has.

    Args:
        names: Their names.
        sections: Name of the section of each.
        offsets: Place of each in its section's frame [m], shape (markers, 3).
    """

    names: tuple[str, ...]
    sections: tuple[str, ...]
    offsets: Floats

    def of(self, section: str) -> list[int]:
        """List the markers of a section."""
        return [k for k, name in enumerate(self.sections) if name == section]


@dataclass(frozen=True)
class Points:
    """Recorded points, in which sections are looked for.

    Args:
        places: Places of the recorded markers [m], shape (samples, markers, 3).
        markers: Markers of the specimen.
        fits: Fits so far, by section, its markers' labels, and whether an axis is mirrored.
    """

    places: Floats
    markers: MarkerLayout
    fits: dict[tuple[str, Labels, bool], Fit] = field(default_factory=dict)


@dataclass(frozen=True)
class Labelling:
    """One explanation: the recorded name of each marker, and whether an axis is mirrored."""

    labels: Labels
    mirrored: bool


def correct_labels(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Find exchanged markers and a mirrored laboratory, and correct them where one explanation wins."""
    markers = _layout(recording, specimen)
    if not any(len(markers.of(section)) >= 3 for section in set(markers.sections)):
        return recording, ()
    points = Points(_samples(recording, markers), markers)
    if not len(points.places):
        return recording, ()
    sensible = Labelling(tuple(range(len(markers.names))), False)
    tried = [
        Explanation(Labelling(labels, mirrored), _likelihood(points, specimen, labels, mirrored))
        for labels, mirrored in product(_labellings(markers), (False, True))
    ]
    choice = choose(tried)
    best = choice.best.what
    worst = _worst(points, best.labels, best.mirrored)
    if worst > MISFIT * PLACED:
        what = f"the markers lie up to {1e3 * worst:.0f} mm off their places in the specimen under any names"
        cure = "give the specimen whose markers these are, or correct their offset_m"
        return recording, (
            RecordingFault(recording.name, "labels", markers.names, what, cure, corrected=False),
        )
    if best == sensible:
        return recording, ()
    before = _worst(points, sensible.labels, False)
    rivals = _rivals(tried, choice.best)
    shown = _shown(recording, specimen, markers, rivals)
    if shown is None:
        names, kind = _at_fault(markers, best)
        what = ", or ".join(describe(markers, one) for one in rivals[:3])
        cure = "correct the names or the axes of the export: neither frames nor pressures show which it is"
        return recording, (RecordingFault(recording.name, kind, names, what, cure, corrected=False),)
    if shown == sensible:
        return recording, ()
    odds = choice.odds if choice.unambiguous and shown == best else np.inf
    after = _worst(points, shown.labels, shown.mirrored)
    return _renamed(recording, specimen, markers, shown, odds, before, after)


def likelihood_as_named(recording: Recording, specimen: Specimen) -> float:
    """Compute the logarithm of the likelihood of markers under their names, in the better handedness."""
    markers = _layout(recording, specimen)
    points = Points(_samples(recording, markers), markers)
    if not len(points.places):
        return 0.0
    labels = tuple(range(len(markers.names)))
    return max(_likelihood(points, specimen, labels, mirrored) for mirrored in (False, True))


def _layout(recording: Recording, specimen: Specimen) -> MarkerLayout:
    """Collect the specimen's markers that a recording saw."""
    chosen = [
        marker
        for marker in specimen.markers
        if marker.name in recording.markers and np.isfinite(recording.marker(marker.name)).all(axis=1).any()
    ]
    return MarkerLayout(
        tuple(m.name for m in chosen),
        tuple(m.section for m in chosen),
        np.array([m.offset_m for m in chosen]),
    )


def _rivals(tried: Sequence[Explanation[Labelling]], best: Explanation[Labelling]) -> list[Labelling]:
    """List the best explanation and those that the markers leave open, the likeliest first.

    Names alone do not decide: an explanation that fits the markers as well is open, unless it is far less
    probable before they are seen.
    """
    clear = np.log(UNAMBIGUOUS)
    expected = _prior(best.what)
    rivals = [
        one
        for one in tried
        if one.log_likelihood > best.log_likelihood - clear
        or (
            _prior(one.what) > expected - DOUBTED
            and one.log_likelihood - _prior(one.what) > best.log_likelihood - expected - clear
        )
    ]
    return [one.what for one in sorted(rivals, key=lambda one: -one.log_likelihood)]


def _shown(
    recording: Recording, specimen: Specimen, markers: MarkerLayout, rivals: Sequence[Labelling]
) -> Labelling | None:
    """Return the only one of some explanations that frames or pressures agree with."""
    if len(rivals) == 1:
        return rivals[0]
    corrected = [_applied(recording, specimen, markers, one) for one in rivals]
    tried = [(one, own) for one, (own, where) in zip(rivals, corrected, strict=True) if where is not None]
    shown = only_agreeing([own for _, own in tried], specimen)
    return None if shown is None else tried[shown][0]


def _renamed(
    recording: Recording,
    specimen: Specimen,
    markers: MarkerLayout,
    best: Labelling,
    odds: float,
    before: float,
    after: float,
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    names, kind = _at_fault(markers, best)
    corrected, where = _applied(recording, specimen, markers, best)
    if where is None:
        what = f"{describe(markers, best)}, and under no axis are the markers in the laboratory of the frames"
        cure = "export frames and markers in one right-handed laboratory"
        return recording, (RecordingFault(recording.name, "frame", names, what, cure, False, odds),)
    if before > after + 1e-4:
        fits = f"the markers fit their sections to {1e3 * after:.1f} instead of {1e3 * before:.1f} mm"
    else:  # markers in one plane fit their section either way
        fits = "only so do the sections lie and point as they do in the specimen"
    what = f"{describe(markers, best, where)}: {fits}"
    mismatch = RecordingFault(recording.name, kind, names, what, "corrected for this run", True, odds)
    return corrected, (mismatch,)


def _at_fault(markers: MarkerLayout, best: Labelling) -> tuple[tuple[str, ...], Kind]:
    """Return the names of the markers at fault, all of them for a mirrored axis, and the kind of fault."""
    moved = tuple(markers.names[k] for k, label in enumerate(best.labels) if label != k)
    return (moved, "labels") if moved else (markers.names, "frame")


def _applied(
    recording: Recording, specimen: Specimen, markers: MarkerLayout, best: Labelling
) -> tuple[Recording, str | None]:
    """Correct names and the mirrored axis; name the axis, or return ``None`` where frames contradict all.

    Without frames any axis will do, since the base's markers register the rest.
    """
    columns = dict(recording.columns)
    for k, label in enumerate(best.labels):
        for suffix in MARKER_SUFFIXES:
            columns[f"marker_{markers.names[k]}_{suffix}"] = recording.columns[
                f"marker_{markers.names[label]}_{suffix}"
            ]
    corrected = replace(recording, columns=columns)
    if not best.mirrored:
        return corrected, ""
    if not any(np.isfinite(recording.pose(section)).any() for section in recording.frames):
        return mirror_markers(corrected, 0), "one axis of the laboratory frame"
    alone = [mirror_markers(corrected, axis) for axis in range(3)]
    tried = [*alone, *(mirror_frames(one, axis, whole=True) for axis, one in enumerate(alone))]
    found = shown_by_markers(tried, specimen)
    if found is None:
        return recording, None
    together, axis = divmod(found, 3)
    of = "laboratory, in positions and orientations," if together else "markers, and not of the frames,"
    return tried[found], f"the {AXES[axis]} axis of the {of}"


def describe(markers: MarkerLayout, labelling: Labelling, where: str | None = None) -> str:
    """Describe which markers bear whose name, and which axis is mirrored."""
    pairs = [
        f"{markers.names[label]} is named {markers.names[k]}"
        for k, label in enumerate(labelling.labels)
        if label != k
    ]
    if len(pairs) == 2 and labelling.labels != tuple(range(len(labelling.labels))):
        one, other = (markers.names[k] for k, label in enumerate(labelling.labels) if label != k)
        pairs = [f"markers {one} and {other} are exchanged"]
    elif pairs:
        pairs = ["markers are permuted (" + ", ".join(pairs) + ")"]
    if labelling.mirrored:
        pairs.append(f"{where or 'one axis of the laboratory frame'} is mirrored")
    return " and ".join(pairs) or "the markers as they are named"


def _samples(recording: Recording, markers: MarkerLayout) -> Floats:
    """Choose samples in which every marker was seen, shape (samples, markers, 3)."""
    points = np.stack([recording.marker(name) for name in markers.names], axis=1)
    valid = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))
    if not len(valid):
        return np.zeros((0, len(markers.names), 3))
    chosen: Floats = points[valid[np.unique(np.linspace(0, len(valid) - 1, FRAMES).astype(int))]]
    return chosen


def _labellings(markers: MarkerLayout) -> Iterator[Labels]:
    """Yield labellings, the recorded one first."""
    count = len(markers.names)
    if count <= WHOLE:
        yield from permutations(range(count))
        return
    listed: set[Labels] = set()
    for labels in (*_exchanges(count), *_within_sections(markers)):
        if labels not in listed:
            listed.add(labels)
            yield labels


def _exchanges(count: int) -> Iterator[Labels]:
    """Yield the recorded labels, every exchange of two, and every two exchanges."""
    plain = tuple(range(count))
    yield plain
    pairs = list(combinations(range(count), 2))
    for first, second in ((first, second) for first in pairs for second in (None, *pairs)):
        labels = list(plain)
        for pair in filter(None, (first, second)):
            labels[pair[0]], labels[pair[1]] = labels[pair[1]], labels[pair[0]]
        yield tuple(labels)


def _within_sections(markers: MarkerLayout) -> Iterator[Labels]:
    """Yield every permutation within each section, together with exchanges of whole sections of one size."""
    groups = [markers.of(section) for section in dict.fromkeys(markers.sections)]
    orders: list[Sequence[Sequence[int]]] = [groups]
    for a, b in combinations(range(len(groups)), 2):
        if len(groups[a]) == len(groups[b]):
            exchanged = list(groups)
            exchanged[a], exchanged[b] = groups[b], groups[a]
            orders.append(exchanged)
    for order in orders:
        for parts in product(*(permutations(group) for group in order)):
            labels = [0] * len(markers.names)
            for group, part in zip(groups, parts, strict=True):
                for place, label in zip(group, part, strict=True):
                    labels[place] = label
            yield tuple(labels)


def _prior(labelling: Labelling) -> float:
    moved = sum(label != k for k, label in enumerate(labelling.labels))
    return MOVED * moved + MIRRORED * labelling.mirrored


def _likelihood(points: Points, specimen: Specimen, labels: Labels, mirrored: bool) -> float:
    fitted = _fits(points, labels, mirrored)
    value = _prior(Labelling(labels, mirrored))
    for name, (_, _, errors) in fitted.items():
        count = 3 * len(points.markers.of(name)) - 6
        value -= 0.5 * max(float(np.median(errors**2, axis=0).sum()) / PLACED**2 - count, 0.0)
    base = specimen.sections[0]
    if base.name not in fitted:
        return value
    rotations, centres, _ = fitted[base.name]
    rest = from_quaternions(np.array(base.frame_quaternion))
    for section in specimen.sections[1:]:
        if section.name not in fitted:
            continue
        rotated, placed, _ = fitted[section.name]
        relative = np.einsum("nji,njk->nik", rotations, rotated)
        place = np.einsum("nji,nj->ni", rotations, placed - centres)
        expected = rest.T @ (np.array(section.frame_origin_m) - np.array(base.frame_origin_m))
        away = np.median(np.linalg.norm(place - expected, axis=1)) / (REACH * np.linalg.norm(expected))
        columns: Floats = rest.T @ from_quaternions(np.array(section.frame_quaternion))
        tilt = np.median(np.linalg.norm(log(relative @ columns.T), axis=-1)) / TILT
        value -= 0.5 * float(away**2 + tilt**2)
    return value


def _fits(points: Points, labels: Labels, mirrored: bool) -> dict[str, Fit]:
    """Fit each section with three markers or more; most labellings share most sections' fits."""
    markers, fits = points.markers, {}
    for section in dict.fromkeys(markers.sections):
        columns = markers.of(section)
        if len(columns) >= 3:
            key = section, tuple(labels[k] for k in columns), mirrored
            if key not in points.fits:
                seen = points.places[:, list(key[1])] * (np.array([-1.0, 1.0, 1.0]) if mirrored else 1.0)
                points.fits[key] = _fit(seen, markers.offsets[columns])
            fits[section] = points.fits[key]
    return fits


def _fit(points: Floats, offsets: Floats) -> Fit:
    """Fit a section to its markers, shape (samples, markers, 3)."""
    middle, centre = offsets.mean(axis=0), points.mean(axis=1)
    products = np.einsum("nmi,mj->nij", points - centre[:, None], offsets - middle)
    rotations = nearest_rotation(products)
    origins = centre - rotations @ middle
    errors = points - origins[:, None] - np.einsum("nij,mj->nmi", rotations, offsets)
    return rotations, origins, np.linalg.norm(errors, axis=2)


def _worst(points: Points, labels: Labels, mirrored: bool) -> float:
    """Compute the largest of the markers' median distances from their places [m]."""
    errors = [np.median(part, axis=0).max() for _, _, part in _fits(points, labels, mirrored).values()]
    return float(max(errors, default=0.0))

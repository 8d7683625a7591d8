"""Markers of one rigid body whose names change places during a recording.

The distances in a body do not change, and from one sample to the next it hardly rotates. Where names change
places, markers jump by the distance between them; under the names before, the body goes on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, permutations

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.intake.bodies import rigid_bodies
from softarm.estimator.intake.hypotheses import Explanation, choose
from softarm.estimator.intake.labels import WHOLE, Labels, likelihood_as_named
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import MARKER_SUFFIXES, Recording
from softarm.estimator.specimen import Specimen

GOES_ON = 0.25
"""Share of a jump that is left at most under other names: a body rotates by less than a quarter of a radian
between two samples."""
LISTED = 3
"""Stretches up to which each is listed."""


@dataclass(frozen=True)
class Stretch:
    """Samples in which names stay.

    Args:
        rows: Samples in which every marker of the body was seen.
        labels: Column that holds each of the markers which the first stretch names.
    """

    rows: Indices
    labels: Labels

    def under_names_of(self, other: "Stretch") -> Labels:
        """Return which column of this stretch belongs to each name as another stretch uses it."""
        labels = [0] * len(self.labels)
        for own, name in zip(self.labels, other.labels, strict=True):
            labels[name] = own
        return tuple(labels)


def correct_exchanges(
    recording: Recording, specimen: Specimen
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Correct marker names that are exchanged within a body during a recording, where this is unambiguous."""
    faults: list[RecordingFault] = []
    for names in rigid_bodies(recording, specimen):
        places = np.stack([recording.marker(name) for name in names], axis=1)
        stretches, jumps = _stretches(places)
        if len(stretches) < 2:
            continue
        # A stretch for each way in which the markers are named.
        ways = list({one.labels: one for one in stretches}.values())
        tried = [
            Explanation(corrected, likelihood_as_named(corrected, specimen))
            for corrected in (_under_names(recording, names, stretches, way) for way in ways)
        ]
        choice = choose(tried)
        way = next(w for w, one in zip(ways, tried, strict=True) if one is choice.best)
        what = _describe(recording.time, names, stretches, way, jumps)
        if choice.unambiguous:
            recording = choice.best.what
            cure = "corrected for this run"
        else:
            cure = f"correct the names in the export: which are right is not clear (odds {choice.odds:.0f})"
        columns = tuple(f"marker_{name}" for name in names)
        faults.append(
            RecordingFault(recording.name, "labels", columns, what, cure, choice.unambiguous, choice.odds)
        )
    return recording, tuple(faults)


def _stretches(places: Floats) -> tuple[list[Stretch], list[tuple[float, float]]]:
    """Split a recording where names change places.

    Args:
        places: Of the markers of a body [m], NaN where lost, shape (samples, markers, 3).

    Returns:
        The stretches, and by how much markers jump between them [m]: as named, and as the body goes on.
    """
    count = places.shape[1]
    rows = np.flatnonzero(np.isfinite(places).all(axis=(1, 2)))
    plain = tuple(range(count))
    shape = places[rows] - places[rows].mean(axis=1, keepdims=True)
    orders = list(permutations(plain)) if count <= WHOLE else [plain, *_exchanges(count)]
    steps = np.array([np.linalg.norm(shape[1:, list(o)] - shape[:-1], axis=2).max(axis=1) for o in orders])
    best = steps.argmin(axis=0)
    nearest = _nearest(shape[:1])
    changes = np.flatnonzero((steps.min(axis=0) < GOES_ON * steps[0]) & (steps[0] > GOES_ON * nearest))
    labels, found, jumps = plain, [], []
    for begin, end in pairwise([0, *(changes + 1), len(rows)]):
        if begin:
            order = orders[best[begin - 1]]
            labels = tuple(order[column] for column in labels)
            jumps.append((float(steps[0, begin - 1]), float(steps[best[begin - 1], begin - 1])))
        found.append(Stretch(rows[begin:end], labels))
    return found, jumps


def _exchanges(count: int) -> list[Labels]:
    exchanged = []
    for one, other in combinations(range(count), 2):
        order = list(range(count))
        order[one], order[other] = other, one
        exchanged.append(tuple(order))
    return exchanged


def _nearest(shape: Floats) -> float:
    """Return the least distance between two markers [m]; infinite without a sample."""
    pairs = combinations(range(shape.shape[1]), 2)
    return min(
        (float(np.linalg.norm(shape[0, a] - shape[0, b])) for a, b in pairs if len(shape)), default=np.inf
    )


def _under_names(
    recording: Recording, names: Sequence[str], stretches: Sequence[Stretch], way: Stretch
) -> Recording:
    """Name the markers throughout as one stretch does; between stretches nothing shows which is which."""
    columns = dict(recording.columns)
    for suffix in MARKER_SUFFIXES:
        recorded = [recording.columns[f"marker_{name}_{suffix}"] for name in names]
        for number, name in enumerate(names):
            values = recorded[number].copy()
            for before, after in pairwise(stretches):
                values[before.rows[-1] + 1 : after.rows[0]] = np.nan
            for stretch in stretches:
                begin = 0 if stretch is stretches[0] else stretch.rows[0]
                during = slice(begin, None if stretch is stretches[-1] else stretch.rows[-1] + 1)
                values[during] = recorded[stretch.under_names_of(way)[number]][during]
            columns[f"marker_{name}_{suffix}"] = values
    return replace(recording, columns=columns)


def _describe(
    time: Floats,
    names: Sequence[str],
    stretches: Sequence[Stretch],
    way: Stretch,
    jumps: Sequence[tuple[float, float]],
) -> str:
    """State which names change places, when, and by how much markers jump there."""
    others = [one for one in stretches if one.labels != way.labels]
    moved = sorted({k for one in others for k, label in enumerate(one.under_names_of(way)) if k != label})
    listed = ", ".join(names[k] for k in moved[:-1]) + f" and {names[moved[-1]]}"
    spans = [f"from {time[one.rows[0]]:.2f} to {time[one.rows[-1]]:.2f} s" for one in others]
    when = (
        " and ".join(spans)
        if len(spans) <= LISTED
        else f"{len(spans)} times between {time[others[0].rows[0]]:.2f} and {time[others[-1].rows[-1]]:.2f} s"
    )
    far, near = (1e3 * max(sizes) for sizes in zip(*jumps, strict=True))
    how = "exchanged" if len(moved) == 2 else "permuted"
    return (
        f"markers {listed} of one body are {how} {when}: between two samples they jump by {far:.1f} mm "
        f"as they are named, and by {near:.2f} mm under the other names"
    )

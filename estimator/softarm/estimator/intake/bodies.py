"""Markers of one rigid body: the distances between them are those of the specimen."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen

MISPLACED = 10.0
"""Difference of a distance from the specimen's, in those of a marker's noise, that is far more than noise."""
IN_PLACE = 3.0
"""Difference up to which both markers of a pair are in their places."""

Pair = tuple[str, str]


def rigid_bodies(recording: Recording, specimen: Specimen) -> list[tuple[str, ...]]:
    """List the recorded markers of each section that has three or more of them."""
    bodies = [
        tuple(m.name for m in specimen.markers if m.section == section.name and m.name in recording.markers)
        for section in specimen.sections
    ]
    return [names for names in bodies if len(names) >= 3]


def correct_places(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Leave out a marker that is off its place in its body, or report that it is unclear which one is."""
    faults = []
    for names in rigid_bodies(recording, specimen):
        off = _differences(recording, specimen, names)
        largest = max(off, key=lambda pair: abs(off[pair]), default=None)
        if largest is None or abs(off[largest]) <= MISPLACED * specimen.noise.marker_m:
            continue
        possible = [
            name
            for name in names
            if all(abs(d) < IN_PLACE * specimen.noise.marker_m for pair, d in off.items() if name not in pair)
        ]
        needed = {m.name for m in specimen.markers if m.section == specimen.sections[0].name} & {*names}
        if len(possible) == 1 and (not needed or len(needed) > 3):
            (name,) = possible
            faults.append(_left_out(recording, name, off))
            gone = f"marker_{name}_"
            kept = {n: v for n, v in recording.columns.items() if not n.startswith(gone)}
            recording = replace(recording, columns=kept)
        else:
            faults.append(_unclear(recording, names, largest, off[largest], possible))
    return recording, tuple(faults)


def _differences(recording: Recording, specimen: Specimen, names: tuple[str, ...]) -> dict[Pair, float]:
    """Compute distances in a body minus those of the specimen [m], of pairs that were seen together."""
    offsets = {m.name: np.array(m.offset_m) for m in specimen.markers}
    off = {}
    for one, other in combinations(names, 2):
        apart = np.linalg.norm(recording.marker(one) - recording.marker(other), axis=1)
        if np.isfinite(apart).any():
            nominal = float(np.linalg.norm(offsets[one] - offsets[other]))
            off[one, other] = float(np.nanmedian(apart)) - nominal
    return off


def _left_out(recording: Recording, name: str, off: Mapping[Pair, float]) -> RecordingFault:
    own = {next(n for n in pair if n != name): d for pair, d in off.items() if name in pair}
    rest = max(abs(d) for pair, d in off.items() if name not in pair)
    listed = " and ".join(f"{1e3 * d:+.1f} mm from {other}" for other, d in own.items())
    what = (
        f"marker {name} is off its place in its body: its distances differ from the specimen's by {listed}, "
        f"those between the others by {1e3 * rest:.1f} mm at most"
    )
    cure = "left out of this run; correct its offset_m in the specimen if it is fixed there"
    return RecordingFault(recording.name, "labels", (f"marker_{name}",), what, cure)


def _unclear(
    recording: Recording, names: tuple[str, ...], pair: Pair, difference: float, possible: list[str]
) -> RecordingFault:
    which = f"{' or '.join(possible)} is" if possible else "several of them are"
    what = (
        f"{which} off the place in the specimen: of the distances between markers {', '.join(names)}, that "
        f"from {pair[0]} to {pair[1]} differs by {1e3 * difference:+.1f} mm"
    )
    cure = "used as they are; correct their offset_m in the specimen"
    return RecordingFault(recording.name, "labels", tuple(f"marker_{name}" for name in names), what, cure)

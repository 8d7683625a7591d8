"""Markers of one rigid body: the distances between them do not change."""

from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen


def rigid_bodies(recording: Recording, specimen: Specimen) -> list[tuple[str, ...]]:
    """List the recorded markers of each section that has three or more of them."""
    bodies = [
        tuple(m.name for m in specimen.markers if m.section == section.name and m.name in recording.markers)
        for section in specimen.sections
    ]
    return [names for names in bodies if len(names) >= 3]

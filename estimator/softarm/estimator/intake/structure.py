"""Whether a recording is one of the specimen: its chambers, sections and markers."""

from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import SHIPPED, Specimen


def misfit(recording: Recording, specimen: Specimen) -> tuple[RecordingFault, ...]:
    """List what of a recording the specimen lacks, as one refusal; empty where it fits."""
    words = []
    count = len(specimen.chambers)
    strange = [k for k in recording.chambers if k >= count]
    if strange:
        words.append(f"it has chambers {_listed(recording.chambers)}, the specimen {count}")
    sections = [section.name for section in specimen.sections]
    for kind, names in (("bends", recording.bends), ("frames", recording.frames)):
        unknown = [name for name in names if name not in sections]
        if unknown:
            words.append(
                f"it has {kind} of {_listed(unknown)}, the specimen's sections are {_listed(sections)}"
            )
    known = {marker.name for marker in specimen.markers}
    bodies = [name for name in recording.markers if name != "hook"]
    if bodies and not known & set(bodies) and not recording.bends and not recording.frames:
        words.append(f"its markers are {_listed(bodies)}, the specimen's {_listed(sorted(known)) or 'none'}")
    named = recording.info.get("specimen")
    if isinstance(named, str) and named != specimen.name and not named.endswith(".toml"):
        fewer = recording.chambers and len(recording.chambers) < count and recording.chambers[-1] < count - 1
        if fewer and (recording.bends or recording.frames or recording.markers):
            words.append(f"it has chambers {_listed(recording.chambers)}, the specimen {count}")
        if words or {named, specimen.name} <= {*SHIPPED}:
            words.insert(0, f"it was recorded on {named!r}, not on {specimen.name!r}")
    if not words:
        return ()
    cure = (
        f"give --specimen {named}"
        if isinstance(named, str) and named != specimen.name
        else "give the specimen that was recorded, or remove the columns"
    )
    return (
        RecordingFault(
            recording.name, "structure", ("specimen",), "; ".join(dict.fromkeys(words)), cure, mended=False
        ),
    )


def _listed(names: object) -> str:
    return ", ".join(map(str, names)) if isinstance(names, list | tuple) else str(names)

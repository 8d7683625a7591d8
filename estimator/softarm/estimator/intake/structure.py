"""Whether a recording is one of the specimen: its chambers, sections and markers."""

from pathlib import Path

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
    declared = isinstance(named, str) and specimen.name in (named, Path(named).stem)
    chambers = recording.chambers
    # One pressure alone may be all that was connected; several that end early look like another arm's.
    fewer = 1 < len(chambers) < count and chambers[-1] < count - 1
    if not declared and fewer and (recording.bends or recording.frames or recording.markers):
        words.append(f"it has chambers {_listed(chambers)}, the specimen {count}")
    if isinstance(named, str) and not declared and (words or {named, specimen.name} <= {*SHIPPED}):
        words.insert(0, f"it was recorded on {named!r}, not on {specimen.name!r}")
    if not words:
        return ()
    cure = (
        f"give --specimen {named}"
        if isinstance(named, str) and named != specimen.name
        else f"set specimen = {specimen.name!r} in recording.toml if the others stayed vented, or give the "
        "specimen that was recorded"
        if not declared and fewer
        else "give the specimen that was recorded, or remove the columns"
    )
    return (
        RecordingFault(
            recording.name, "structure", ("specimen",), "; ".join(dict.fromkeys(words)), cure, mended=False
        ),
    )


def _listed(names: object) -> str:
    return ", ".join(map(str, names)) if isinstance(names, list | tuple) else str(names)

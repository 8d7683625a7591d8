"""All steps of an intake, in the order in which each may rely on the one before."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from softarm.estimator.errors import InputError
from softarm.estimator.intake.bodies import correct_places
from softarm.estimator.intake.clocks import correct_clocks
from softarm.estimator.intake.events import find_events
from softarm.estimator.intake.exchanges import correct_exchanges
from softarm.estimator.intake.frozen import frozen_pressures, unread_pressures
from softarm.estimator.intake.labels import correct_labels
from softarm.estimator.intake.limits import over_limit
from softarm.estimator.intake.lost import correct_lost, correct_placeholders, correct_unrecorded
from softarm.estimator.intake.mounts import check_mount
from softarm.estimator.intake.result import Intake, RecordingFault, without_motion
from softarm.estimator.intake.sections import correct_bends, correct_sections
from softarm.estimator.intake.signs import correct_signs
from softarm.estimator.intake.stuck import correct_stuck
from softarm.estimator.intake.stuck_pressures import stuck_pressures, without_pressures
from softarm.estimator.intake.swapped import refuse_swapped_channels
from softarm.estimator.intake.time_axis import correct_time
from softarm.estimator.intake.units import correct_units
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import SHIPPED, Specimen


def misfit(recording: Recording, specimen: Specimen) -> tuple[RecordingFault, ...]:
    """List what of a recording the specimen lacks, as one refusal; empty where it fits."""
    words = []
    count = len(specimen.chambers)
    strange = [k for k in recording.chambers if k >= count]
    if strange:
        words.append(_chambers(recording, count))
    sections = [section.name for section in specimen.sections]
    for kind, names in (("bends", recording.bends), ("frames", recording.frames)):
        unknown = [name for name in names if name not in sections]
        if unknown:
            words.append(
                f"it has {kind} of {_listed(unknown)}, the specimen's sections are {_listed(sections)}"
            )
    described = {marker.name for marker in specimen.markers}
    bodies = [name for name in recording.markers if name != "hook"]
    if bodies and not described & set(bodies) and not recording.bends and not recording.frames:
        words.append(
            f"its markers are {_listed(bodies)}, the specimen's {_listed(sorted(described)) or 'none'}"
        )
    named = recording.info.get("specimen")
    declared = isinstance(named, str) and specimen.name in (named, Path(named).stem)
    chambers = recording.chambers
    # One pressure alone may be all that was connected; several that end early look like another arm's.
    fewer = 1 < len(chambers) < count and chambers[-1] < count - 1
    if not declared and fewer and (recording.bends or recording.frames or recording.markers):
        words.append(_chambers(recording, count))
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
            recording.name, "structure", ("specimen",), "; ".join(dict.fromkeys(words)), cure, corrected=False
        ),
    )


def _chambers(recording: Recording, count: int) -> str:
    """State which chambers were recorded and how many the specimen has."""
    which = "chambers" if len(recording.chambers) > 1 else "chamber"
    return f"it has {which} {_listed(recording.chambers)}, the specimen has {count or 'none'}"


def _listed(names: object) -> str:
    return ", ".join(map(str, names)) if isinstance(names, list | tuple) else str(names)


def _swapped(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Refuse channels that look exchanged without any model, since the wrong one cannot be identified."""
    try:
        refuse_swapped_channels(recording, specimen)
    except InputError as error:
        return recording, (
            RecordingFault(recording.name, "labels", (), error.what, error.cure, corrected=False),
        )
    return recording, ()


Step = Callable[[Recording, Specimen], tuple[Recording, tuple[RecordingFault, ...]]]
STEPS: tuple[Step, ...] = (
    correct_time,
    correct_unrecorded,
    correct_placeholders,
    correct_units,
    correct_lost,
    correct_exchanges,
    correct_stuck,
    correct_signs,
    correct_sections,
    correct_labels,
    correct_places,
    check_mount,
    correct_clocks,
    correct_bends,
    _swapped,
)


def check_recording(recording: Recording, specimen: Specimen, mirrored: int | None = None) -> Intake:
    """Check a recording against its specimen, correct what is unambiguous, and find what no fit may see.

    Args:
        recording: The recording.
        specimen: The robot.
        mirrored: Axis of the laboratory that is mirrored in other recordings of it.

    Returns:
        The recording, corrected, with every fault and event that was found. A refused recording is not
        searched on.
    """
    intake = Intake(recording, misfit(recording, specimen))
    for step in STEPS:
        if intake.refusals:
            return intake
        found = partial(correct_sections, mirrored=mirrored) if step is correct_sections else step
        corrected, faults = found(intake.recording, specimen)
        intake = intake.with_recording(corrected, faults)
    beyond, limits = over_limit(intake.recording, specimen)
    frozen, unrecorded = frozen_pressures(intake.recording, specimen)
    unread, lost = unread_pressures(intake.recording)
    intake = intake.with_recording(intake.recording, (*limits, *unrecorded, *lost))
    if intake.refusals:
        return intake
    stretches = (*beyond, *frozen, *unread)
    driven = without_pressures(intake.recording, stuck_pressures(intake.recording), by_set_points=True)
    events = find_events(without_motion(driven, stretches), specimen)
    return Intake(
        intake.recording,
        intake.mismatches,
        events,
        (*stretches, *(event.interval for event in events)),
        beyond,
    )

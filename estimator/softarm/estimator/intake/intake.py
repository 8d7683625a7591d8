"""All steps of an intake, in the order in which each may rely on the one before."""

from collections.abc import Callable

from softarm.estimator.diagnosis.swapped import refuse_swapped_channels
from softarm.estimator.errors import InputError
from softarm.estimator.intake.clocks import mend_clocks
from softarm.estimator.intake.events import find_events
from softarm.estimator.intake.labels import mend_labels
from softarm.estimator.intake.limits import over_limit
from softarm.estimator.intake.lost import mend_lost
from softarm.estimator.intake.mounts import check_mount
from softarm.estimator.intake.result import Intake, RecordingFault
from softarm.estimator.intake.sections import mend_bends, mend_sections
from softarm.estimator.intake.signs import mend_signs
from softarm.estimator.intake.structure import misfit
from softarm.estimator.intake.times import mend_time
from softarm.estimator.intake.units import mend_units
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen


def _swapped(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Refuse channels that look exchanged without any model: which of the two is wrong, nobody can tell."""
    try:
        refuse_swapped_channels(recording, specimen)
    except InputError as error:
        return recording, (
            RecordingFault(recording.name, "labels", (), error.what, error.cure, mended=False),
        )
    return recording, ()


Step = Callable[[Recording, Specimen], tuple[Recording, tuple[RecordingFault, ...]]]
STEPS: tuple[Step, ...] = (
    mend_time,
    mend_units,
    mend_lost,
    mend_signs,
    mend_labels,
    mend_sections,
    mend_bends,
    check_mount,
    _swapped,
    mend_clocks,
)


def take_in(recording: Recording, specimen: Specimen) -> Intake:
    """Check a recording against its specimen, mend what is unambiguous, and find what no fit may see.

    Args:
        recording: What was recorded.
        specimen: The robot.

    Returns:
        The recording, mended, with every fault and event that was found. A refused recording is not
        searched on.
    """
    intake = Intake(recording, misfit(recording, specimen))
    for step in STEPS:
        if intake.refusals:
            return intake
        mended, found = step(intake.recording, specimen)
        intake = intake.with_recording(mended, found)
    stretches, limits = over_limit(intake.recording, specimen)
    intake = intake.with_recording(intake.recording, limits)
    if intake.refusals:
        return intake
    events = find_events(Intake(intake.recording, excluded=stretches).for_fits, specimen)
    return Intake(
        intake.recording,
        intake.mismatches,
        events,
        (*stretches, *(event.interval for event in events)),
        stretches,
    )

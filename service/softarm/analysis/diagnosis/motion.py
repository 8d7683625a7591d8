"""The recordings of a diagnosis beside its report, for the page that plays them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from softarm.analysis.offline.inputs import SPECIMEN_FILE
from softarm.estimator.diagnosis.result import Diagnosis
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen, save_specimen
from softarm.recordings import load_recording, save_recording

FOLDER = "motion"


def motion_file(out: Path, recording: str) -> Path:
    """Return where the motion of a recording is kept; its name may hold folders."""
    return out / FOLDER / f"{recording.replace('/', '-')}.mcap"


def specimen_file(out: Path) -> Path:
    """Return where the specimen of a diagnosis is kept."""
    return out / FOLDER / SPECIMEN_FILE


def write_motions(diagnosis: Diagnosis, specimen: Specimen, out: Path) -> Path:
    """Write the motion of every recording in question, and the specimen; earlier ones are replaced.

    Args:
        diagnosis: The result; one of valves alone has no motion.
        specimen: The arm.
        out: Folder of the report.

    Returns:
        The folder of the files.
    """
    for name in diagnosis.recordings:
        motion_file(out, name).unlink(missing_ok=True)
    for motion in diagnosis.motions:
        save_recording(motion, motion_file(out, motion.name))
    specimen_file(out).parent.mkdir(exist_ok=True)
    save_specimen(specimen, specimen_file(out))
    return out / FOLDER


def load_motions(out: Path, recordings: Sequence[str]) -> list[Recording]:
    """Load the recordings of a diagnosis.

    Args:
        out: Folder of the report.
        recordings: Their names, as the report states them.

    Raises:
        InputError: None was kept.
    """
    files = [motion_file(out, name) for name in recordings]
    found = [
        replace(load_recording(file), name=name)
        for file, name in zip(files, recordings, strict=True)
        if file.is_file()
    ]
    if not found:
        cure = "repeat it with softarm diagnose --force; one of valves alone has report.html and no page"
        raise InputError(str(out), "holds a diagnosis without motion", cure)
    return found

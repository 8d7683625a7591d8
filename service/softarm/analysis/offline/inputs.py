"""What offline commands begin with: recordings, their specimen, their model, a window of time."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from softarm.estimator.calibration.arrange import gravity_of
from softarm.estimator.errors import InputError
from softarm.estimator.intake import Intake, check_recording
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import SHIPPED, Specimen, load_specimen, parse_specimen
from softarm.recordings import load_recording, read_attachments
from softarm.recordings.info import sidecar
from softarm.recordings.load import data_file

SPECIMEN_FILE = "specimen.toml"


def load_recordings(
    paths: Sequence[Path], window: tuple[float, float] | None = None
) -> tuple[Recording, ...]:
    """Load recordings, each cut to a window of its time [s] where one is given.

    Recordings of one name in different folders are named with as many of their folders as distinguish them.
    Their units are not checked: that is left to ``check_and_correct``, which corrects what is unambiguous.

    Raises:
        InputError: A recording cannot be read, is given twice, or has no samples in the window.
    """
    loaded = [cut(load_recording(path, units_checked=False), window) for path in paths]
    names = distinct_names([recording.name for recording in loaded], paths)
    return tuple(replace(recording, name=name) for recording, name in zip(loaded, names, strict=True))


def distinct_names(names: Sequence[str], paths: Sequence[Path]) -> tuple[str, ...]:
    """Return distinct names of recordings, with the folders above where their own names are equal.

    Args:
        names: What the recordings are called.
        paths: Where each is.

    Raises:
        InputError: A recording is given twice.
    """
    places = [path.resolve() for path in paths]
    files = [data_file(path).resolve() if path.is_dir() else path.resolve() for path in paths]
    for path, file in zip(paths, files, strict=True):
        if files.count(file) > 1:
            raise InputError(f"recording {path}", "is given twice", "name every recording once")
    chosen = list(names)
    depth = 2
    while len(set(chosen)) < len(chosen):
        chosen = [
            "/".join(place.parts[-depth:]) if names.count(name) > 1 else name
            for name, place in zip(names, places, strict=True)
        ]
        depth += 1
    return tuple(chosen)


def cut(recording: Recording, window: tuple[float, float] | None) -> Recording:
    """Keep the samples within a window of time [s].

    Raises:
        InputError: There are none, or the window ends before it begins.
    """
    if window is None:
        return recording
    if not window[0] < window[1]:
        raise InputError(
            "--window", f"{window[0]:g} s is not before {window[1]:g} s", "give the earlier time first"
        )
    inside = (recording.time >= window[0]) & (recording.time <= window[1])
    if not inside.any():
        raise InputError(
            f"{recording.name}, --window",
            f"has no samples between {window[0]:g} and {window[1]:g} s",
            f"it lasts from {recording.time[0]:g} to {recording.time[-1]:g} s",
        )
    return recording.window(np.asarray(inside))


def specimen_of(given: str | None, paths: Sequence[Path], recordings: Sequence[Recording]) -> Specimen:
    """Load the named specimen, else the one in the first recording, else the one that it names.

    Raises:
        InputError: There is none, or it cannot be read.
    """
    if given is not None:
        return load_specimen(given)
    attached = read_attachments(paths[0]).get(SPECIMEN_FILE)
    if attached is not None:
        return parse_specimen(attached, f"{paths[0]}, {SPECIMEN_FILE}")
    named = recordings[0].info.get("specimen")
    if named is None:
        raise InputError(str(paths[0]), "names no specimen", "give it with --specimen")
    data = data_file(paths[0])
    try:
        if str(named) in SHIPPED:
            return load_specimen(str(named))
        near_recording = data.parent / str(named)
        return load_specimen(near_recording if near_recording.is_file() else str(named))
    except InputError as error:
        metadata = sidecar(data) if sidecar(data).is_file() else data
        raise InputError(f"{metadata}, specimen", f"{named!r}: {error.what}", error.cure) from None


def specimen_of_any(given: str | None, paths: Sequence[Path]) -> Specimen:
    """Load the named specimen, else that of the first recording that can be read.

    Raises:
        InputError: No recording can be read, or there is no specimen, or it cannot be read.
    """
    if given is not None:
        return load_specimen(given)
    refusals: list[InputError] = []
    for path in paths:
        try:
            recording = load_recording(path, units_checked=False)
        except InputError as error:
            refusals.append(error)
        else:
            return specimen_of(None, [path], [recording])
    raise refusals[0]


def check_and_correct(
    recording: Recording, specimen: Specimen, notify: Callable[[str], None], mirrored: int | None = None
) -> Intake:
    """Check and correct a recording: its units, labels and clocks; find its events, and report each.

    Args:
        recording: The recording.
        specimen: The robot.
        notify: Called with each in words.
        mirrored: Axis of the laboratory that is mirrored in other recordings of it.

    Raises:
        InputError: It does not fit the specimen and cannot be corrected unambiguously.
    """
    intake = check_recording(recording, specimen, mirrored).required()
    for sentence in intake.sentences:
        notify(sentence)
    return intake


def in_its_mount(specimen: Specimen, recording: Recording) -> Specimen:
    """Return the specimen in the mount of a recording, whose ``gravity_m_s2`` counts where it has one.

    Raises:
        InputError: It is not three finite numbers.
    """
    if "gravity_m_s2" not in recording.info:
        return specimen
    return specimen.model_copy(update={"gravity_m_s2": tuple(gravity_of(recording, specimen).tolist())})

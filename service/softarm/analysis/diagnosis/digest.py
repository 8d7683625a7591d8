"""Whether a diagnosis was done before: its folder keeps a digest of all that went into it."""

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

from softarm import estimator, recordings
from softarm.analysis.diagnosis.report import FILE, Report, read_report
from softarm.analysis.diagnosis.run import DiagnosisRequest
from softarm.common import rods
from softarm.estimator.errors import InputError
from softarm.estimator.files import write_whole
from softarm.recordings.info import sidecar
from softarm.recordings.load import is_mcap

DIGEST = "report.digest"
"""File beside the report; it is written last, so that it stands for a whole report."""


def digest_of(request: DiagnosisRequest) -> str:
    """Return a digest of recordings, specimen, seed, effects and the program itself.

    Raises:
        OSError: A recording cannot be read.
    """
    words = (request.seed, *sorted(request.effects), len(request.nominal), request.specimen.model_dump_json())
    found = sha256(" ".join(map(str, words)).encode())
    for path in _sources():
        found.update(path.read_bytes())
    for path in (*request.recordings, *request.nominal):
        for file in _files_of(path):
            if file.is_file():
                found.update(f"{path.name}/{file.name}".encode())
                found.update(file.read_bytes())
    return found.hexdigest()


def report_up_to_date(out: Path, digest: str) -> Report | None:
    """Return the report of a folder if it is whole and has the same digest; else ``None``."""
    if _kept(out)[:1] != [digest]:
        return None
    try:
        return read_report(out)
    except InputError:
        return None


def require_free_folder(out: Path, request: DiagnosisRequest, *, force: bool) -> None:
    """Refuse a folder that nothing can be written to, or that holds the diagnosis of other recordings.

    Raises:
        InputError: It is one.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(str(out), f"cannot be made: {error.strerror}", "choose another --out") from None
    try:
        earlier = set(read_report(out).recordings)
    except InputError:
        return
    # A recording is called after its file, or after its folder where that is recording.csv.
    names = {name for path in map(Path.resolve, request.recordings) for name in (path.stem, path.parent.name)}
    if not force and not any(name.endswith(tuple(names)) for name in earlier):
        raise InputError(
            str(out),
            f"holds the diagnosis of {', '.join(sorted(earlier))}",
            "choose another --out, or replace it with --force",
        )


def specimen_up_to_date(out: Path, specimen: Path) -> bool:
    """Return whether a file is the specimen that the diagnosis in a folder wrote, unchanged."""
    return specimen.is_file() and _kept(out)[1:] == [_digest_of_file(specimen)]


def write_report(report: Report, out: Path) -> Path:
    """Write ``report.json`` whole; a digest of an earlier one no longer holds."""
    (out / DIGEST).unlink(missing_ok=True)
    write_whole({out / FILE: report.dump().encode()})
    return out / FILE


def write_digest(digest: str, out: Path, specimen: Path | None = None) -> None:
    """Write the digests of a report's inputs and of the written specimen, once all else is written."""
    lines = [digest] if specimen is None else [digest, _digest_of_file(specimen)]
    write_whole({out / DIGEST: "".join(f"{line}\n" for line in lines).encode()})


def _kept(out: Path) -> list[str]:
    file = out / DIGEST
    return file.read_text().split() if file.is_file() else []


def _digest_of_file(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def _files_of(recording: Path) -> list[Path]:
    """List the files that a recording may consist of."""
    if recording.is_dir():
        return sorted(recording.iterdir())
    return [recording] if is_mcap(recording) else [recording, sidecar(recording)]


def _sources() -> Iterator[Path]:
    """List the files of the program on which a diagnosis depends, shipped rods and specimens among them."""
    yield Path(rods.__file__)
    for folder in (Path(estimator.__path__[0]), Path(recordings.__path__[0]), Path(__file__).parents[1]):
        files = (path for path in folder.rglob("*") if path.is_file())
        # Compiled code appears as the program runs.
        yield from sorted(path for path in files if "__pycache__" not in path.parts)

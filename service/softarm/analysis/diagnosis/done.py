"""Whether a diagnosis was done before: its folder keeps a digest of all that went into it."""

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

from softarm import estimator
from softarm.analysis.diagnosis.report import FILE, Report, read_report
from softarm.analysis.diagnosis.run import DiagnosisRequest
from softarm.estimator.files import write_whole

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
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        for file in files:
            if file.is_file():
                found.update(f"{path.name}/{file.name}".encode())
                found.update(file.read_bytes())
    return found.hexdigest()


def done_before(out: Path, digest: str) -> Report | None:
    """Return the report of a folder if it came of the same; else ``None``."""
    kept = out / DIGEST
    if not kept.is_file() or kept.read_text().strip() != digest:
        return None
    return read_report(out)


def write_report(report: Report, out: Path) -> Path:
    """Write ``report.json`` whole; a digest of an earlier one no longer holds."""
    (out / DIGEST).unlink(missing_ok=True)
    write_whole({out / FILE: report.dump().encode()})
    return out / FILE


def write_digest(digest: str, out: Path) -> None:
    """Note what the report in a folder came of, once all of it is written."""
    write_whole({out / DIGEST: f"{digest}\n".encode()})


def _sources() -> Iterator[Path]:
    """List the source files on which a diagnosis depends."""
    yield from sorted(Path(estimator.__path__[0]).rglob("*.py"))
    yield from sorted(path for path in Path(__file__).parent.iterdir() if path.is_file())

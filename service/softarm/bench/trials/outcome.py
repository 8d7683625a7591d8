"""The outcome of one diagnosis of one trial, and the file that keeps all of them."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from softarm.estimator.errors import InputError


@dataclass(frozen=True)
class TrialOutcome:
    """The outcome of one diagnosis of one trial.

    Args:
        trial: Name of the trial.
        seconds: How long it took.
        recorded_s: Length of all its recordings.
        status: Exit status of the diagnosis; -1 when it was ended for its time.
        message: Its last line on standard error when it wrote no report.
        report: ``report.json`` as a table; empty when there is none.
        digest: Of all that went into it; see ``digest_of``.
        core_s: Its processor time; 0 in outcomes from before that was measured.
    """

    trial: str
    seconds: float
    recorded_s: float
    status: int
    message: str
    report: dict[str, Any]
    digest: str = ""
    core_s: float = 0.0

    def line(self) -> str:
        """Write it as one line of JSON."""
        return json.dumps(asdict(self)) + "\n"


OUTCOME = TypeAdapter(TrialOutcome)


def add_outcome(outcome: TrialOutcome, path: Path) -> None:
    """Add an outcome to those of earlier runs; what a killed run left of a line is overwritten."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        file.seek(0)
        whole = file.read().rpartition(b"\n")
        file.truncate(len(whole[0]) + len(whole[1]))
        file.write(outcome.line().encode())


def read_outcomes(path: Path) -> list[TrialOutcome]:
    """Read the outcomes of earlier runs, whole lines only; none where there is no file.

    Raises:
        InputError: A line is no outcome.
    """
    if not path.exists():
        return []
    lines = path.read_bytes().rpartition(b"\n")[0].splitlines()
    return [_outcome(line, f"{path}, line {number}") for number, line in enumerate(lines, 1) if line]


def _outcome(line: bytes, place: str) -> TrialOutcome:
    try:
        return OUTCOME.validate_json(line)
    except ValidationError:
        raise InputError(
            place, "is not the outcome of a trial", "delete that line, or give another --out"
        ) from None

"""What a diagnosis costs against the length of what it is given."""

from collections.abc import Callable

from service.bench.proof.schedule import SealedTrial
from service.bench.proof.trial import Folders, diagnose, record
from service.cli.output import Cell, Table

TRIAL = SealedTrial("single", 4901)
COUNTS = (2, 4, 8, 12)
"""Numbers of suspect runs that are diagnosed together."""


def cost_table(folders: Folders, specimen: str, say: Callable[[str], None]) -> Table:
    """Time diagnoses of more and more runs of one trial, each on one core.

    Args:
        folders: Where the proof works.
        specimen: What the tool is given.
        say: Tells how far it is.
    """
    say("cost: recording")
    record(TRIAL, folders)
    rows: list[dict[str, Cell]] = []
    for count in COUNTS:
        say(f"cost: diagnosing {count} runs")
        outcome = diagnose(TRIAL, f"first {count}", folders, specimen)
        rows.append(
            {
                "runs": count,
                "recorded_s": outcome.recorded_s,
                "took_s": outcome.seconds,
                "took_over_recorded": outcome.seconds / outcome.recorded_s,
                "with_report": bool(outcome.report),
            }
        )
    return Table("Cost against length", rows, ("One process each, the nominal runs included in the length.",))

"""``softarm bench diagnosis``: diagnoses blind trials, and scores them where there are answers."""

from pathlib import Path

import click

from softarm.bench.trials.folders import read_answer, read_trials
from softarm.bench.trials.outcome import TrialOutcome
from softarm.bench.trials.page import from_source, write_page
from softarm.bench.trials.run import run_trials
from softarm.bench.trials.score import score
from softarm.bench.trials.tables import score_tables
from softarm.cli.output import PATH, folder_option, json_option, notify, progress, show
from softarm.common.tables import Cell, Table

HEAD = "# Blind trials of the diagnosis\n\nWritten by `softarm bench diagnosis --write`."

jobs_option = click.option(
    "--jobs",
    "-j",
    default=2,
    show_default=True,
    type=click.IntRange(1),
    help="Number of trials to run in parallel.",
)


@click.command()
@click.option(
    "--trials",
    "folder",
    required=True,
    type=PATH,
    help="Folder of trials: NAME/trial.toml, NAME/nominal/RUN, NAME/questioned/RUN.",
)
@click.option("--answers", type=PATH, help="Folder of answers, NAME.toml, to score against.")
@folder_option("Folder of reports and outcomes; an interrupted run resumes from it.", "out/trials")
@jobs_option
@click.option("--source", help="Where the trials come from, added to the titles of the tables.")
@click.option("--write", type=PATH, help="Write the scores to a page in Markdown; its other tables are kept.")
@json_option
def command(
    folder: Path,
    answers: Path | None,
    out: Path,
    jobs: int,
    source: str | None,
    write: Path | None,
    as_json: bool,
) -> int:
    """Diagnose blind trials, and score them if answers are given.

    Each trial is diagnosed by 'softarm diagnose' in a process of its own, which never sees the answers. The
    exit status is 1 if a trial ended without a report.

    Example: softarm bench diagnosis --trials TRIALS --answers ANSWERS --source "our arm" --write proof.md
    """
    if write is not None and answers is None:
        raise click.UsageError("--write writes scores, which need --answers.")
    trials = read_trials(folder)
    truth = None if answers is None else {trial.name: read_answer(answers, trial.name) for trial in trials}
    with progress(f"diagnosing {len(trials)} trials", len(trials)) as advance:
        outcomes = run_trials(trials, out, jobs, advance)
    scores = [] if truth is None else [score(outcome, truth[outcome.trial]) for outcome in outcomes]
    tables = score_tables(scores) if scores else ()
    if source:
        tables = tuple(from_source(tables, source))
    show(_verdicts(outcomes), *tables, as_json=as_json)
    if write is not None:
        write_page(write, tables, HEAD)
        notify(f"wrote {write}")
    return int(not all(outcome.report for outcome in outcomes))


def _verdicts(outcomes: list[TrialOutcome]) -> Table:
    """List the verdict of each diagnosis."""
    rows: list[dict[str, Cell]] = [
        {
            "trial": outcome.trial,
            "verdict": outcome.report.get("verdict"),
            "findings": ", ".join(_finding(f) for f in outcome.report.get("findings", [])) or None,
            "took_s": outcome.seconds,
            "error": outcome.message or None,
        }
        for outcome in outcomes
    ]
    return Table("Diagnoses", rows)


def _finding(finding: dict[str, object]) -> str:
    where = finding["where"]
    assert isinstance(where, dict)
    place = " ".join(str(value) for value in where.values() if value is not None)
    return f"{finding['effect']} ({place})" if place else str(finding["effect"])

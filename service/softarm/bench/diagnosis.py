"""``softarm bench diagnosis``: diagnoses blind trials, and scores them where answers are given."""

from pathlib import Path

import click

from softarm.bench.trials.folders import read_answer, read_trials
from softarm.bench.trials.outcome import TrialOutcome
from softarm.bench.trials.run import run_trials
from softarm.bench.trials.score import score
from softarm.bench.trials.tables import score_tables
from softarm.cli.output import json_option, progress, show
from softarm.common.tables import Cell, Table

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
    type=click.Path(path_type=Path),
    help="Folder of trials: NAME/trial.toml, NAME/nominal/RUN, NAME/questioned/RUN.",
)
@click.option(
    "--answers", type=click.Path(path_type=Path), help="Folder of answers, NAME.toml, to score against."
)
@click.option(
    "--out",
    "-o",
    type=click.Path(path_type=Path),
    default=Path("out/trials"),
    show_default=True,
    help="Folder of reports and outcomes; an interrupted run resumes from it.",
)
@jobs_option
@json_option
def command(folder: Path, answers: Path | None, out: Path, jobs: int, as_json: bool) -> int:
    """Diagnose blind trials, and score them if answers are given.

    Each trial is diagnosed by 'softarm diagnose' in a process of its own, which never sees the answers. The
    status is 1 when a trial ended without a report.

    Example: softarm bench diagnosis --trials TRIALS --answers ANSWERS
    """
    trials = read_trials(folder)
    truth = None if answers is None else {trial.name: read_answer(answers, trial.name) for trial in trials}
    with progress(f"diagnosing {len(trials)} trials", len(trials)) as advance:
        outcomes = run_trials(trials, out, jobs, advance)
    tables = [_said(outcomes)]
    if truth is not None:
        tables += score_tables([score(outcome, truth[outcome.trial]) for outcome in outcomes])
    show(*tables, as_json=as_json)
    return int(not all(outcome.report for outcome in outcomes))


def _said(outcomes: list[TrialOutcome]) -> Table:
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

"""``softarm bench diagnosis``: the proof of the diagnosis on sealed trials and beside its alternatives."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import click

from softarm.cli.output import json_option, progress, quick_option, say, show
from softarm.common.tables import Table

if TYPE_CHECKING:
    from softarm.bench.proof.schedule import SealedTrial
    from softarm.bench.proof.trial import Folders

EXCITATIONS = ("designed", "ordinary")
PARTS = ("trials", "alternatives", "force", "cost")
HEAD = """# The proof of the diagnosis

Written by `softarm bench diagnosis --write docs/diagnosis-proof.md`.

Each sealed trial is an arm of the fake (`docs/fake-arm.md`): rigid bodies and fibres in a physics engine,
with the tolerances, the creep, the hysteresis and the noise of real ones, recorded before and after something
was concealed in it. `softarm diagnose` gets the recordings and the drawing of the arm, nothing else;
the answers lie in a folder that only the scorer opens.
"""


@click.command()
@click.option("--trials", default=20, show_default=True, type=click.IntRange(1), help="Sealed trials.")
@click.option(
    "--seed", default=1, show_default=True, help="Of the first trial of each kind; the others count on."
)
@click.option("--jobs", default=2, show_default=True, type=click.IntRange(1), help="Trials at once.")
@click.option("--at-most", type=click.IntRange(0), help="End after so many new diagnoses; they are kept.")
@click.option(
    "--folder",
    type=click.Path(path_type=Path),
    default=Path("out/diagnosis-proof"),
    show_default=True,
    help="Recordings, answers, reports and results; a run goes on from what is there.",
)
@click.option("--specimen", default="sopra", show_default=True, help="Drawing that the tool is given.")
@click.option("--keep", is_flag=True, help="Keep the recordings of every trial.")
@click.option(
    "--part",
    "parts",
    multiple=True,
    type=click.Choice(PARTS),
    default=PARTS,
    help="What to prove; all when left out.",
)
@click.option("--forces", default=12, show_default=True, help="Trials on whose pull the force is estimated.")
@click.option("--write", type=click.Path(path_type=Path), help="Write the tables to a page; its others stay.")
@quick_option
@json_option
def command(
    trials: int,
    seed: int,
    jobs: int,
    at_most: int | None,
    folder: Path,
    specimen: str,
    keep: bool,
    parts: tuple[str, ...],
    forces: int,
    write: Path | None,
    quick: bool,
    as_json: bool,
) -> int:
    """Prove the diagnosis: sealed trials scored per effect, alternatives, forces before and after.

    Trials are recorded by the fake arm and diagnosed by the command line, each in processes of its own; the
    results are kept as JSON lines, and a run that was interrupted goes on.

    Example: softarm bench diagnosis --trials 40 --write docs/diagnosis-proof.md
    """
    from softarm.bench.proof.schedule import schedule
    from softarm.bench.proof.trial import Folders

    folders = Folders(folder)
    planned = schedule(2 if quick else trials, seed)
    excitations = EXCITATIONS[:1] if quick else EXCITATIONS
    tables: list[Table] = []
    if "trials" in parts:
        _run_all(planned, excitations, folders, specimen, jobs, at_most, keep=keep)
        tables += _scored(planned, folders)
    if "alternatives" in parts:
        from softarm.bench.proof.alternatives import alternatives_table

        tables.append(alternatives_table(folders, specimen, say))
    if "force" in parts:
        from softarm.bench.proof.force import force_table

        tables.append(force_table(folders, specimen, say, 1 if quick else forces))
    if "cost" in parts:
        from softarm.bench.proof.cost import cost_table

        tables.append(cost_table(folders, specimen, say))
    show(*tables, as_json=as_json)
    if write is not None:
        from softarm.bench.proof.page import renewed

        page = write.read_text("utf-8") if write.exists() else HEAD
        write.write_text(renewed(page, tables), encoding="utf-8")
        say(f"wrote {write}")
    return 0


def _run_all(
    planned: "Sequence[SealedTrial]",
    excitations: Sequence[str],
    folders: "Folders",
    specimen: str,
    jobs: int,
    at_most: int | None,
    *,
    keep: bool,
) -> None:
    """Record and diagnose what has no result yet."""
    from softarm.bench.proof.trial import add_outcome, diagnose, forget, read_outcomes, record

    done = {(one.trial, one.excitation) for one in read_outcomes(folders.results)}
    waiting = [(t, e) for e in excitations for t in planned if (t, e) not in done][:at_most]
    writing = Lock()

    def one(trial: "SealedTrial", wanted: Sequence[str], advance: Callable[[float], None]) -> None:
        record(trial, folders)
        for excitation in wanted:
            outcome = diagnose(trial, excitation, folders, specimen)
            with writing:
                add_outcome(outcome, folders.results)
            advance(1)
        if not keep and len(wanted) == len(excitations):
            forget(trial, folders)

    by_trial = {t: [e for other, e in waiting if other == t] for t, _ in waiting}
    with progress("sealed trials", len(waiting)) as advance, ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(one, trial, wanted, advance) for trial, wanted in by_trial.items()]
        for future in as_completed(running):
            future.result()


def _scored(planned: "Sequence[SealedTrial]", folders: "Folders") -> tuple[Table, ...]:
    """Score what there is of the plan."""
    from softarm.bench.proof.score import score
    from softarm.bench.proof.tables import proof_tables, ran_table
    from softarm.bench.proof.trial import read_outcomes

    known = set(planned)
    scores = [score(one, folders) for one in read_outcomes(folders.results) if one.trial in known]
    return (*proof_tables(scores), ran_table(scores)) if scores else ()

"""The command of the proof."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import click

from acceptance.proof.alternatives import alternatives_table
from acceptance.proof.cost import cost_table
from acceptance.proof.force import force_table
from acceptance.proof.schedule import SealedTrial, schedule
from acceptance.proof.sensitivity import CHOICE, VALVES, sensitivity_table
from acceptance.proof.swing import swing_table
from acceptance.proof.touches import touches_table
from acceptance.proof.trial import Folders, forget, lay_out, name_of, record
from softarm.bench.diagnosis import jobs_option
from softarm.bench.trials.folders import read_answer, read_trials
from softarm.bench.trials.outcome import read_outcomes
from softarm.bench.trials.page import from_source, write_page
from softarm.bench.trials.run import run_trials
from softarm.bench.trials.score import score
from softarm.bench.trials.tables import score_tables
from softarm.cli.output import PATH, json_option, notify, progress, quick_option, show
from softarm.common.tables import Table

MOTIONS = ("designed", "ordinary")
PARTS = ("trials", "alternatives", "force", "cost")
ON_REQUEST = ("swing", "touches", "sensitivity", "valves")
"""Parts that are left out unless they are named; the last three are on all trials that were kept."""
HEAD = """# The proof of the diagnosis

Written by `softarm bench proof --write docs/diagnosis-proof.md`.

Each sealed trial is an arm of the fake (`docs/fake-arm.md`): rigid bodies and fibres in a physics engine,
with the tolerances, the creep, the hysteresis and the noise of real ones, recorded before and after something
was concealed in it. `softarm diagnose` gets the recordings and the drawing of the arm, nothing else;
the answers lie in a folder that only the scorer opens.
"""


@click.command()
@click.option("--count", default=20, show_default=True, type=click.IntRange(1), help="Sealed trials.")
@click.option(
    "--seed", default=1, show_default=True, help="Of the first trial of each kind; the others count on."
)
@jobs_option
@click.option(
    "--folder",
    type=PATH,
    default=Path("out/diagnosis-proof"),
    show_default=True,
    help="Recordings, answers, reports and outcomes; a run that was ended goes on from what is there.",
)
@click.option(
    "--specimen",
    default="sopra",
    show_default=True,
    help="Drawing of the arms, which the diagnosis is given: a shipped specimen or a file.",
)
@click.option("--keep", is_flag=True, help="Keep the recordings of every trial.")
@click.option(
    "--part",
    "parts",
    multiple=True,
    type=click.Choice(PARTS + ON_REQUEST),
    default=PARTS,
    help="What to prove. When left out: all but swing, and but touches, sensitivity and valves (the "
    "sensitivity of what is said of these), which are on the trials that --keep kept.",
)
@click.option(
    "--compared",
    default=6,
    show_default=True,
    help="Trials on which alternatives are compared, and on whose pull the force is estimated.",
)
@click.option("--write", type=PATH, help="Write the tables to a page; its others stay.")
@quick_option
@json_option
def command(
    count: int,
    seed: int,
    jobs: int,
    folder: Path,
    specimen: str,
    keep: bool,
    parts: tuple[str, ...],
    compared: int,
    write: Path | None,
    quick: bool,
    as_json: bool,
) -> int:
    """Prove the diagnosis on the fake arm: trials, alternatives, forces, cost, swing, touches, sensitivities.

    Example: softarm bench proof --count 40 --write docs/diagnosis-proof.md
    """
    folders = Folders(folder)
    planned = schedule(2 if quick else count, seed, specimen)
    motions = MOTIONS[:1] if quick else MOTIONS
    tables: list[Table] = []
    if "trials" in parts:
        run_fake_trials(planned, motions, folders, jobs, keep=keep)
        tables += from_source(scored(planned, motions, folders), "fake arm")
    acting = [trial for trial in planned if trial.kind in ("single", "pair")][: 1 if quick else compared]
    if "alternatives" in parts:
        tables.append(alternatives_table(acting, folders, notify))
    if "force" in parts:
        tables.append(force_table(folders, notify, 1 if quick else compared))
    if "cost" in parts:
        tables.append(cost_table(acting[0], folders, notify))
    if "swing" in parts:
        single = [trial for trial in acting if trial.kind == "single"]
        tables.append(swing_table(single, folders, notify))
    if "touches" in parts:
        tables.append(touches_table(read_trials(folders.trials), folders, notify))
    for part, decided in (("sensitivity", CHOICE), ("valves", VALVES)):
        if part in parts:
            kept = folders.root / "products"
            tables.append(sensitivity_table(decided, read_trials(folders.trials), kept, notify))
    show(*tables, as_json=as_json)
    if write is not None:
        write_page(write, tables, HEAD)
        notify(f"wrote {write}")
    return 0


def run_fake_trials(
    planned: Sequence[SealedTrial],
    motions: Sequence[str],
    folders: Folders,
    jobs: int,
    *,
    keep: bool,
) -> None:
    """Record and diagnose the trials that have no outcome yet.

    Args:
        planned: Which trials.
        motions: Which of their runs are in question, one diagnosis for each.
        folders: Where.
        jobs: Arms at a time.
        keep: Keep recordings after their diagnosis.
    """
    known = {outcome.trial for outcome in read_outcomes(folders.results)}
    with (
        progress("sealed trials", len(planned) * len(motions)) as advance,
        ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as arms,
        ThreadPoolExecutor(jobs) as pool,
    ):

        def one(trial: SealedTrial) -> None:
            waiting = [motion for motion in motions if name_of(trial, motion) not in known]
            advance(len(motions) - len(waiting))
            if waiting:
                arms.submit(record, trial, folders).result()
                laid_out = [lay_out(trial, motion, folders) for motion in waiting]
                run_trials(laid_out, folders.root, 1, advance)
                if not keep:
                    forget(trial, folders)

        list(pool.map(one, planned))


def scored(planned: Sequence[SealedTrial], motions: Sequence[str], folders: Folders) -> tuple[Table, ...]:
    """Score what there is of the plan."""
    names = {name_of(trial, motion) for trial in planned for motion in motions}
    scores = [
        score(outcome, read_answer(folders.answers, outcome.trial))
        for outcome in read_outcomes(folders.results)
        if outcome.trial in names
    ]
    return score_tables(scores) if scores else ()

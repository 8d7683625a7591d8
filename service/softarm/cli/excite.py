"""``softarm excite --arm ID``: run the manoeuvres that separate the physical effects, and record them."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softarm.cli.output import (
    PATH,
    PICTURE,
    NumberRange,
    folder_option,
    json_option,
    notify,
    progress,
    show,
)
from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.common.tables import Cell, Table
from softarm_client.session import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from softarm.estimator.excitation import ExcitationPlan, Manoeuvre
    from softarm.estimator.specimen import Specimen
    from softarm.experiments.excitation import Recorded
    from softarm_client import Arm


@click.command()
@click.option("--arm", help="Name of the arm; its service moves it.")
@click.option("--fake", is_flag=True, help="Start fakes and a service on them, and run there.")
@click.option(
    "--endpoint", default=DEFAULT_ENDPOINT, show_default=True, help="zenoh endpoint of the service."
)
@click.option("--zenoh", "zenoh_config", type=PATH, help="JSON5 file with credentials.")
@click.option(
    "--report",
    type=PATH,
    help="Folder of a diagnosis; run only what separates the effects that it could not distinguish.",
)
@click.option("--manoeuvre", "names", multiple=True, help="Run only this manoeuvre; may be repeated.")
@click.option("--by-hand", is_flag=True, help="An operator is present to turn the mount and pluck the arm.")
@click.option(
    "--share",
    type=NumberRange(0.05, 1.0),
    default=0.75,
    show_default=True,
    help="Fraction of the pressure limits to use.",
)
@click.option("--minutes", type=NumberRange(min=0.1), help="Leave out manoeuvres that would end later.")
@click.option("--dry-run", is_flag=True, help="Print the plan and move nothing.")
@click.option("--plot", type=PICTURE, help="Write a picture of the planned pressures.")
@folder_option("With --fake: folder of the service's configuration, logs and recordings.", "out/excite")
@click.option(
    "--specimen",
    "-s",
    metavar="S",
    help="With --fake or --dry-run: a specimen file, or the name of a shipped one.",
)
@json_option
def command(
    arm: str | None,
    fake: bool,
    endpoint: str,
    zenoh_config: Path | None,
    report: Path | None,
    names: tuple[str, ...],
    by_hand: bool,
    share: float,
    minutes: float | None,
    dry_run: bool,
    plot: Path | None,
    out: Path,
    specimen: str | None,
    as_json: bool,
) -> int:
    """Run the manoeuvres that distinguish physical effects, and record each of them.

    With --report, the command predicts for each manoeuvre how well it separates the candidate effects of the
    diagnosis per second, and runs only the manoeuvres that are needed. Pressures and their rates stay within
    the limits of the specimen and the valves. The arm is vented before each manoeuvre and at the end.

    Example: softarm excite --arm sopra --report out/diagnosis --dry-run
    """
    from softarm.experiments.excitation import run_excitation, slew_of, specimen_of_arm
    from softarm.experiments.excitation_plan import DEFAULT_SLEW, manoeuvres_of

    if (arm and fake) or not (arm or fake or dry_run):
        raise click.UsageError("give either --arm ID, --fake or --dry-run")
    with ExitStack() as stack:
        client = None if dry_run else _connect(stack, arm, endpoint, zenoh_config, out, specimen)
        robot = _offline_specimen(specimen, report) if client is None else specimen_of_arm(client)
        slew = (slew_of(client) if client is not None else None) or DEFAULT_SLEW
        manoeuvres = manoeuvres_of(robot, names, by_hand=by_hand, slew=slew, share=share)
        plan = shortened(_plan(robot, manoeuvres, report), minutes)
        if plot is not None:
            from softarm.analysis.plots.excitation import plot_plan

            notify(f"wrote {plot_plan(plan, plot)}")
        if client is None or not plan.choices:
            show(*plan_tables(plan), as_json=as_json)
            return 0 if plan.choices else 1
        if not as_json:
            show(*plan_tables(plan), as_json=False)
        with client.lease(), progress("exciting the arm", plan.seconds) as advance:
            done = run_excitation(client, plan.choices, _ask, advance)
        show(recorded_table(done), as_json=as_json)
    return 0


def _connect(
    stack: ExitStack,
    arm: str | None,
    endpoint: str,
    zenoh_config: Path | None,
    out: Path,
    specimen: str | None,
) -> "Arm":
    """Connect to the arm's service; without an arm, to one on fakes that ends with the command."""
    from softarm.experiments.rig import PATIENCE, FakeRig, RigSettings
    from softarm.experiments.session import connect, wait_ready
    from softarm_client import Arm

    if arm is not None:
        return stack.enter_context(Arm(arm, endpoint, "softarm excite", zenoh_config=zenoh_config))
    chosen = specimen or str(fake_specimen())
    settings = RigSettings(DEMO_SCENARIO, specimen=chosen, endpoint=endpoint, patience=PATIENCE)
    notify("starting the simulated instruments and the service; the estimator needs half a minute or more")
    client = stack.enter_context(connect(stack.enter_context(FakeRig(settings, out))))
    wait_ready(client)
    return client


def _offline_specimen(specimen: str | None, report: Path | None) -> "Specimen":
    """Load the named specimen, or the one kept with the report, else the one that the report names."""
    from softarm.analysis.diagnosis.motion import specimen_file
    from softarm.analysis.diagnosis.report import read_report
    from softarm.estimator.specimen import load_specimen

    if specimen is None and report is not None:
        named = read_report(report).specimen
        kept = specimen_file(report if report.is_dir() else report.parent)
        return load_specimen(kept if kept.is_file() else named)
    return load_specimen(specimen or "sopra")


def _plan(robot: "Specimen", manoeuvres: Sequence["Manoeuvre"], report: Path | None) -> "ExcitationPlan":
    from softarm.analysis.diagnosis.report import read_report
    from softarm.experiments.excitation_plan import count_of_pairs, make_plan

    read = None if report is None else read_report(report)
    with progress("planning", max(1, count_of_pairs(read) * len(manoeuvres))) as advance:
        return make_plan(robot, manoeuvres, read, advance)


def shortened(plan: "ExcitationPlan", minutes: float | None) -> "ExcitationPlan":
    """Leave out the manoeuvres that would end after some minutes."""
    if minutes is None:
        return plan
    chosen, left = [], 60.0 * minutes
    for choice in plan.choices:
        if choice.seconds <= left:
            chosen.append(choice)
            left -= choice.seconds
    return replace(plan, choices=tuple(chosen))


def _ask(manoeuvre: "Manoeuvre") -> bool:
    """Request what a manoeuvre needs of a person, and return whether it was done."""
    return click.confirm(f"{manoeuvre.name}: {manoeuvre.by_hand}. Done", default=True, err=True)


def plan_tables(plan: "ExcitationPlan") -> tuple[Table, ...]:
    """Arrange a plan: its manoeuvres, and what it decides."""
    rows: list[dict[str, Cell]] = []
    for choice in plan.choices:
        row: dict[str, Cell] = {
            "manoeuvre": choice.manoeuvre.name,
            "seconds": round(choice.seconds, 1),
            "shows": choice.manoeuvre.by_hand or choice.manoeuvre.shows,
        }
        if plan.pairs:
            best = max(range(len(plan.pairs)), key=lambda k: choice.separations[k])
            row |= {"separates_most": plan.pairs[best].name, "separation": choice.separations[best]}
        rows.append(row)
    total = f"{len(rows)} manoeuvres, {plan.seconds / 60.0:.1f} min with venting between them."
    tables = [
        Table(
            "Plan",
            rows,
            (total,) if rows else ("No known manoeuvre would distinguish the remaining effects.",),
        )
    ]
    if plan.pairs:
        tables.append(_pairs_table(plan))
    return tuple(tables)


def _pairs_table(plan: "ExcitationPlan") -> Table:
    from softarm.estimator.excitation.plan import DECISIVE_SEPARATION

    rows: list[dict[str, Cell]] = [
        {
            "pair": pair.name,
            "separation": plan.separation(index),
            "decided": plan.separation(index) >= DECISIVE_SEPARATION,
        }
        for index, pair in enumerate(plan.pairs)
    ]
    notes = (
        "Separation: expected difference in chi-square between the two effects, each fitted again; "
        f"{DECISIVE_SEPARATION:g} decides.",
        *(f"These manoeuvres cannot distinguish {pair.name}." for pair in plan.undecided),
    )
    return Table("Expected separation", rows, notes)


def recorded_table(done: Sequence["Recorded"]) -> Table:
    """Arrange what was run."""
    rows: list[dict[str, Cell]] = [
        {
            "manoeuvre": one.manoeuvre,
            "seconds": round(one.seconds, 1),
            "longest_gap_ms": round(1e3 * one.gap_s, 1),
            "recording": one.path,
        }
        for one in done
    ]
    return Table("Recorded", rows, ("Longest gap: longest time between two accepted set-points.",))

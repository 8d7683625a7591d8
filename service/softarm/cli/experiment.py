"""``softarm experiment NAME (--fake | --arm ID)``: the paper's experiments and their tables."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from softarm.cli.output import PATH, folder_option, force_option, json_option, notify, progress, show
from softarm.common.tables import as_markdown
from softarm.estimator.specimen import load_specimen

if TYPE_CHECKING:
    from softarm.experiments.live import LiveRigSettings
    from softarm.experiments.seed import SeedPlan

Command = TypeVar("Command", bound=Callable[..., Any])


@click.group(no_args_is_help=True)
def command() -> None:
    """Run the paper's experiments and compare the results with the paper.

    Example: softarm experiment force --fake --seeds 1
    """


def _common(command: Command) -> Command:
    """Add the options of every experiment."""
    options = (
        click.option("--fake", is_flag=True, help="Run on a simulated arm, which the command starts."),
        click.option("--arm", metavar="ID", help="Run on the arm of a running service."),
        click.option("--endpoint", help="zenoh endpoint of that service."),
        click.option("--zenoh", "zenoh_config", type=PATH, help="JSON5 file with credentials."),
        click.option(
            "--recorded",
            is_flag=True,
            help="With --fake: simulate the recordings faster than real time, without a service.",
        ),
        click.option(
            "--scenario",
            type=PATH,
            metavar="FILE",
            help="With --fake: scenario of the simulated instruments and their faults.",
        ),
        click.option(
            "--seeds",
            type=click.IntRange(1, 20),
            help="With --fake: number of simulated arms, each with tolerances of its own, and calibrated "
            "first unless --specimen is given. By default the demo's arm alone.",
        ),
        click.option(
            "--jobs", "-j", type=click.IntRange(1), help="Number of processes; by default one per processor."
        ),
        click.option(
            "--specimen", "-s", metavar="S", help="Calibrated specimen; used without calibrating again."
        ),
        click.option(
            "--resume", is_flag=True, help="With --recorded: reuse the results that --out already holds."
        ),
        folder_option(
            "Folder for recordings, plots, tables and the calibrated specimens.", "out/experiments"
        ),
        json_option,
    )
    for option in reversed(options):  # Click lists the one that is added last first
        command = option(command)
    return command


def _experiment(name: str, line: str) -> None:
    @command.command(name, help=f"{line}\n\nExample: softarm experiment {name} --fake")
    @_common
    def run(**options: Any) -> int:
        return _run(name, **options)


for _name, _line in (
    (
        "calibrate",
        "Calibrate jointly on sweeps, random poses and pulls, and compare with the paper's two calibrations.",
    ),
    ("validate", "Predict poses at random pressures from the pressures alone."),
    ("teach", "Teach fifteen poses by hand, hold them by pressures, and measure the pose error."),
    ("force", "Pull with the gauge, vented and pressurised, and compare the estimated force with it."),
):
    _experiment(_name, _line)


@command.command("all")
@_common
@click.option("--write", type=PATH, help="Write all tables as a Markdown page.")
@force_option
def everything(write: Path | None, force: bool, **options: Any) -> int:
    """Run all four experiments on recordings of several simulated arms.

    Example: softarm experiment all --fake --seeds 3 --write docs/experiments.md
    """
    from softarm.estimator.files import require_free

    if write is not None:
        require_free(write, force=force or write.suffix == ".md")
    if not options["fake"]:
        raise click.UsageError(
            "`all` runs on simulated arms only: give --fake; with --arm, run each experiment on its own"
        )
    options |= {"recorded": True, "seeds": options["seeds"] or 1}
    return _run("all", write=write, **options)


def _run(
    name: str,
    *,
    fake: bool,
    arm: str | None,
    endpoint: str | None,
    zenoh_config: Path | None,
    recorded: bool,
    scenario: Path | None,
    seeds: int | None,
    jobs: int | None,
    specimen: str | None,
    out: Path,
    resume: bool,
    as_json: bool,
    write: Path | None = None,
) -> int:
    if fake == (arm is not None):
        raise click.UsageError("give either --fake or --arm ID")
    if recorded and not fake:
        raise click.UsageError("--recorded needs --fake")
    if scenario is not None and (recorded or not fake):
        raise click.UsageError("--scenario needs --fake and excludes --recorded")
    if specimen is not None:
        load_specimen(specimen)  # refuses a wrong one before anything is started
    if not recorded:
        from softarm.experiments.live import LiveRigSettings

        if seeds is not None and not fake:
            raise click.UsageError("--seeds needs --fake")
        settings = LiveRigSettings(out, arm, endpoint, specimen, scenario, zenoh_config=zenoh_config)
        return _live(name, settings, seeds, as_json=as_json)
    from softarm.experiments.campaign import EXPERIMENTS
    from softarm.experiments.seed import SeedPlan

    chosen = EXPERIMENTS if name == "all" else (name,)
    plans = [
        SeedPlan(number, out / f"seed{number}", chosen, calibrated=specimen, resume=resume)
        for number in (range(1) if seeds is None else range(1, seeds + 1))
    ]
    return _recorded(name, plans, jobs, out, as_json=as_json, write=write)


def _recorded(
    name: str, plans: "list[SeedPlan]", jobs: int | None, out: Path, *, as_json: bool, write: Path | None
) -> int:
    from softarm.estimator.files import write_whole
    from softarm.experiments.campaign import default_jobs, run_campaign, summary, tables_of, write_json
    from softarm.experiments.page import experiments_page
    from softarm.experiments.plots import plot_results

    with progress(f"experiment {name}", float(len(plans))) as advance:
        results = run_campaign(plans, jobs or default_jobs(len(plans)), lambda: advance(1))
    tables = (summary(results), *tables_of(results))
    show(*(table for table in tables if table.rows), as_json=as_json)
    write_json(results, out / f"{name}.json")
    write_whole({out / f"{name}.md": f"{as_markdown(*tables)}\n".encode()})
    for path in plot_results(results, out / "plots"):
        notify(f"wrote {path}")
    if write is not None:
        write_whole({write: experiments_page(tables, len(plans)).encode()})
        notify(f"wrote {write}")
    failed = sorted({f"{failure} of seed {r.number}" for r in results for failure in r.failed})
    if failed:
        notify(f"softarm: {', '.join(failed)} failed; see the notes of the table")
    return int(bool(failed))


def _live(name: str, settings: "LiveRigSettings", seeds: int | None, *, as_json: bool) -> int:
    from softarm.estimator.calibration import CalibrationRefusedError
    from softarm.estimator.files import write_whole
    from softarm.experiments.live_tables import ExperimentInteraction, run_live, run_live_arms

    def ask(sentence: str) -> None:
        click.prompt(f"{sentence} Press Enter", default="", show_default=False, err=True)

    if settings.arm is None:
        notify(
            "starting the simulated instruments and the service; the estimator needs half a minute or more"
        )
    try:
        with progress(f"experiment {name}") as advance:
            interaction = ExperimentInteraction(ask, notify, lambda: advance(1))
            if seeds is None:
                tables, _ = run_live(name, settings, 1, interaction)
            else:
                tables = run_live_arms(name, settings, seeds, interaction)
    except CalibrationRefusedError as refusal:
        notify(f"softarm: {refusal}")
        return 1
    out = settings.out
    show(*tables, as_json=as_json)
    write_whole({out / f"{name}.md": f"{as_markdown(*tables)}\n".encode()})
    if name == "calibrate" and seeds is None:
        notify(f"wrote {out / 'specimen.toml'}")
    notify(f"wrote {out / f'{name}.json'}, {name}.md and plots in the same folder")
    return 0

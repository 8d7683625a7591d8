"""``softarm demo``: fakes, service and operator page, and the paper's force experiment on them."""

import signal
from contextlib import ExitStack, suppress
from pathlib import Path

import click

from softarm.cli.output import PORT, folder_option, json_option, notify, progress, show
from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.common.tables import Table
from softarm.experiments.rig import PATIENCE, FakeRig, Process, RigSettings

TOLERANCE_PERCENT = 2.0


@click.command()
@click.option("--once", is_flag=True, help="Exit after the table instead of staying up.")
@click.option("--port", type=PORT, default=8080, show_default=True, help="TCP port of the operator page.")
@folder_option("Folder for the recording, the plot and the logs.", "out/demo")
@json_option
def command(once: bool, port: int, out: Path, as_json: bool) -> int:
    """Start simulated instruments, service and operator page, and run the force experiment.

    The service and the page stay up until Ctrl-C.

    Example: softarm demo --once
    """
    from softarm.experiments.force import STEPS, compare_forces, summary
    from softarm.experiments.live import live_fakes
    from softarm.experiments.session import connect

    specimen = str(fake_specimen())
    settings = RigSettings(DEMO_SCENARIO, specimen=specimen, forces_on=("tip",), patience=PATIENCE)
    # Not blocked: the children would inherit that, and no signal could end them.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with ExitStack() as stack:
        notify(
            "starting the simulated instruments and the service; the estimator needs half a minute or more"
        )
        rig = stack.enter_context(FakeRig(settings, out))
        client = stack.enter_context(connect(rig))
        page = Process(
            ("page", "--arm", settings.arm, "--endpoint", settings.endpoint, "--port", str(port)),
            out / "page.log",
        )
        if not once:
            notify(stack.enter_context(page).first_line().strip())
        with live_fakes(rig, client) as live, progress("force experiment", 2.0 * STEPS) as advance:
            columns, recording = compare_forces(live, lambda: advance(1))
        rows = summary(columns)
        show(Table("External force against the gauge", rows, (f"Recording: {recording}",)), as_json=as_json)
        from softarm.experiments.plots import plot_forces  # Matplotlib: the arm need not wait for it

        plot_forces(columns, out / "force.png")
        notify(f"plot: {out / 'force.png'}")
        if not once:
            notify("running; press Ctrl-C to end")
            with suppress(KeyboardInterrupt):
                signal.pause()
    percents = [row["mean_percent"] for row in rows]
    worst = max(percent if isinstance(percent, float) else float("inf") for percent in percents)
    if worst > TOLERANCE_PERCENT:
        notify(f"softarm: the force is off by {worst:.2f} % of range, more than {TOLERANCE_PERCENT:g} %")
        return 1
    return 0

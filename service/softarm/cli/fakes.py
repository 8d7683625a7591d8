"""``softarm fakes``: the fake instruments on real ports."""

import asyncio
import gc
import json
import signal
from pathlib import Path
from typing import Any

import click
import tomli_w

from softarm.cli.output import PATH, force_option, json_option, notify, show
from softarm.common.shipped import fake_specimen
from softarm.common.tables import Table
from softarm.estimator.files import require_free, write_whole
from softarm.estimator.specimen import load_specimen
from softarm.experiments.rig import RigSettings, service_config
from softarm.fakes.clock import Clock
from softarm.fakes.control import ControlPort, status
from softarm.fakes.devices import catalogue
from softarm.fakes.lateness import watch_lateness
from softarm.fakes.placement import with_specimen
from softarm.fakes.rig import Rig, running
from softarm.fakes.scenario import Scenario, read_scenario


@click.command()
@click.option(
    "--scenario",
    required=True,
    help="Scenario of instruments and their faults: a TOML file, or demo, bench or bad_day.",
)
@click.option(
    "--config",
    type=PATH,
    help="Write a service's configuration that fits these instruments, once they are ready.",
)
@click.option("--specimen", metavar="S", help="Specimen whose arm to simulate; SoPrA when left out.")
@click.option(
    "--variant", type=click.IntRange(0), metavar="N", help="Simulate arm N of its drawing, with tolerances."
)
@force_option
@click.option("--faults", "list_faults", is_flag=True, help="List the faults of each device and exit.")
@json_option
def command(
    scenario: str,
    config: Path | None,
    specimen: str | None,
    variant: int | None,
    force: bool,
    list_faults: bool,
    as_json: bool,
) -> None:
    """Start simulated instruments, each on a real TCP port or pty, until Ctrl-C.

    The command prints the address of each instrument; with --json it prints one line when all are ready.
    Faults of the scenario act at their times; more can be injected on the control port. With --config a
    second terminal can run the service on them: softarm serve --config FILE. With --specimen the simulated
    arm has that specimen's shape, but a material, tolerances and a dynamic model of its own, and the
    instruments of the scenario move to it.

    Example: softarm fakes --scenario bench --config out/service.toml
    """
    checked = read_scenario(scenario)
    if specimen is not None:
        checked = with_specimen(checked, specimen)
    if variant is not None:
        checked = checked.model_copy(update={"plant": checked.plant.model_copy(update={"variant": variant})})
    if list_faults:
        show(_faults_table(checked), as_json=as_json)
        return
    if config is not None:
        require_free(config, force=force)
    asyncio.run(serve(checked, config, specimen, as_json=as_json))


async def serve(
    scenario: Scenario, config: Path | None = None, specimen: str | None = None, *, as_json: bool
) -> None:
    """Run a scenario until a signal ends the process.

    Args:
        scenario: What to run.
        config: File to write a service's configuration for these instruments to.
        specimen: Specimen for that configuration; that of the fake arm when left out.
        as_json: Print the endpoints as one line of JSON instead of a table.
    """
    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    async with running(scenario) as rig:
        control = ControlPort(rig, scenario.control_port or 0)
        if scenario.control_port is not None:
            await control.start()
        gc.collect()
        gc.freeze()  # a full collection of all that is loaded would let the terminal miss its host's deadline
        if config is not None:
            _write_config(rig, config, specimen)
        _announce(rig, control, as_json=as_json)
        watching = asyncio.create_task(watch_lateness(Clock(), notify))
        try:
            await stopped.wait()
        finally:
            watching.cancel()
            await control.stop()
    notify("fakes: stopped")


def _write_config(rig: Rig, path: Path, specimen: str | None) -> None:
    named = specimen or rig.scenario.plant.specimen or str(fake_specimen())
    if Path(named).is_file():
        named = str(Path(named).resolve())
    settings = RigSettings(
        rig.scenario.name,
        specimen=named,
        arm=load_specimen(named).name,
        sensors=("orientation", "bend", "imu"),
    )
    table = service_config(settings, status(rig)["devices"])
    write_whole({path: tomli_w.dumps(table).encode()})
    notify(f"wrote {path}; next: softarm serve --config {path}")


def _announce(rig: Rig, control: ControlPort, *, as_json: bool) -> None:
    at = f"127.0.0.1:{control.port}" if rig.scenario.control_port is not None else None
    if as_json:
        click.echo(json.dumps({"ready": True, "control": at, **status(rig)}))
        return
    rows = [{"device": e.name, "kind": e.kind, "address": e.source} for e in rig.endpoints()]
    notes = (f"control port {at}",) if at else ()
    show(Table(f"Fakes of {rig.scenario.name}", rows, notes), as_json=False)
    notify("fakes: ready; press Ctrl-C to end")


def _faults_table(scenario: Scenario) -> Table:
    def row(device: str, fault: Any) -> dict[str, str]:
        parameters = ", ".join(f"{key} = {value!r}" for key, value in fault.parameters.items())
        acts = "times" if fault.once else "until cleared"
        return {
            "device": device,
            "fault": fault.name,
            "acts": acts,
            "on_the_wire": fault.text,
            "parameters": parameters,
        }

    rows = [row(part.name, fault) for part in scenario.device for fault in catalogue(part)]
    return Table(f"Faults of {scenario.name}", rows)

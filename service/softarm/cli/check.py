"""``softarm check``: what a specimen or a configuration describes, and whether it is valid."""

from pathlib import Path

import click

from softarm.cli.output import PICTURE, json_option, notify, show
from softarm.common.tables import Cell, Table
from softarm.daemon.config import Setup, load_config
from softarm.estimator.errors import InputError
from softarm.estimator.files import read_toml
from softarm.estimator.geometry import DEFAULTS, build_mesh
from softarm.estimator.specimen import Specimen, load_specimen

Row = dict[str, Cell]
CONFIGURATION = ("specimen", "devices", "sensors", "network", "control", "safety", "page")
"""Keys of a service's configuration that no specimen has."""


@click.command()
@click.argument("file")
@click.option("--plot", type=PICTURE, help="Draw the arm that the file describes (PNG).")
@json_option
def command(file: str, plot: Path | None, as_json: bool) -> int:
    """Check a specimen or a service's configuration, and list and draw what it describes.

    FILE is a TOML file, or the name of a shipped specimen: sopra, single_segment, beam. The specimen,
    devices and sensors of a configuration are checked against each other; softarm doctor opens the devices.

    Exit status: 0 valid, 2 not valid; the message names each field that is wrong.

    Example: softarm check my_arm.toml --plot my_arm.png
    """
    if _is_configuration(file):
        setup = load_config(Path(file))
        specimen, tables = setup.specimen, _setup_tables(setup)
    else:
        specimen = load_specimen(file)
        tables = specimen_tables(specimen)
    build_mesh(specimen, DEFAULTS.get(specimen.geometry.kind))  # names what a mesh file lacks
    show(*tables, as_json=as_json)
    if plot is not None:
        draw(specimen, plot)
        notify(f"wrote {plot}")
    notify(f"{file} is valid")
    return 0


def _is_configuration(file: str) -> bool:
    path = Path(file)
    if path.is_dir():
        raise InputError(
            file,
            "is a folder",
            "give a TOML file; `softarm plot` draws a recording, and `softarm estimate` checks it",
        )
    if not path.is_file():
        return False
    table, _ = read_toml(path)
    return any(key in CONFIGURATION for key in table)


def draw(specimen: Specimen, picture: Path) -> None:
    """Draw the body, chambers and sections of a specimen to a picture."""
    from softarm.analysis.plots.figures import save
    from softarm.analysis.plots.specimen import draw_specimen

    save(draw_specimen(specimen), picture)


def specimen_tables(specimen: Specimen) -> tuple[Table, ...]:
    """List segments and sections of a specimen."""
    segments: list[Row] = [
        {
            "segment": segment.name,
            "from_mm": 1e3 * segment.from_m,
            "to_mm": 1e3 * segment.to_m,
            "chambers": ", ".join(str(c.index) for c in specimen.chambers if c.segment == segment.name),
            "limit_kpa": 1e-3 * min((c.pressure_limit_pa for c in specimen.chambers), default=0.0),
        }
        for segment in specimen.segments
    ]
    sections: list[Row] = [
        {"section": section.name, "from_mm": 1e3 * section.from_m, "to_mm": 1e3 * section.to_m}
        for section in specimen.sections
    ]
    note = f"{len(specimen.markers)} markers, {len(specimen.physics)} accepted effects."
    return Table(f"Segments of {specimen.name}", segments), Table("Sections", sections, (note,))


def _setup_tables(setup: Setup) -> tuple[Table, ...]:
    """List what a service would run on: arm, chambers with their limits, devices, sensors."""
    config = setup.config
    arm: Row = {
        "arm": config.arm,
        "specimen": setup.specimen.name,
        "model": config.control.model,
        "rate_hz": config.control.rate_hz,
        "listens_on": ", ".join(config.network.listen),
        "recordings": str(config.recording_directory),
    }
    chambers: list[Row] = [
        {"chamber": chamber, "limit_kpa": 1e-3 * limit} for chamber, limit in enumerate(setup.pressure_limits)
    ]
    devices: list[Row] = [
        {"device": device.name, "kind": device.kind, "simulated": device.simulated}
        for device in setup.devices
    ]
    sensors: list[Row] = [
        {
            "section": sensor.section,
            "measures": sensor.kind,
            "device": sensor.device,
            "channel": sensor.channel,
            "needed": sensor.needed,
        }
        for sensor in config.sensors
    ]
    return (
        Table(f"Configuration {setup.path}", [arm]),
        Table("Chambers", chambers),
        Table("Devices", devices),
        Table("Sensors", sensors),
    )

"""``softarm convert IN OUT``: a recording from one format to another."""

import os
from dataclasses import replace
from pathlib import Path

import click

from softarm.cli.output import PATH, force_option, json_option, notify, progress, show
from softarm.common.tables import Table
from softarm.estimator.recording import Recording
from softarm.recordings import load_recording, output_file, read_attachments, save_recording
from softarm.recordings.load import QUALISYS, data_file, is_mcap
from softarm.recordings.mcap_copy import copy_mcap
from softarm.recordings.summary import summary


@click.command()
@click.argument("source", metavar="IN", type=PATH)
@click.argument("target", metavar="OUT", type=PATH)
@click.option(
    "--map",
    "column_map",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="TOML file with the names of a Qualisys export's markers and bodies; by default the .toml of the "
    "same name as the export.",
)
@force_option
@json_option
def command(source: Path, target: Path, column_map: Path | None, force: bool, as_json: bool) -> None:
    """Convert a recording between MCAP, CSV and Parquet tables, and from Qualisys .c3d and .tsv.

    The suffix of OUT selects the format: .mcap, .csv or .parquet. A path without suffix becomes a folder with
    recording.csv and recording.toml. A file that was cut off is read up to its last complete chunk. From MCAP
    to MCAP every message is kept as it is.

    Example: softarm convert run7.mcap run7
    """
    if column_map is not None and source.suffix.lower() not in QUALISYS:
        raise click.UsageError(f"--map is for Qualisys exports ({', '.join(QUALISYS)}), not for {source}")
    with progress(f"converting {source.name}"):
        recording = _names_its_specimen_from(load_recording(source, column_map), source, target)
        if is_mcap(data_file(source)) and target.suffix == ".mcap" and not target.is_dir():
            written: tuple[Path, ...] = (output_file(target, force=force),)
            copy_mcap(data_file(source), target, recording.info)
        else:
            written = save_recording(recording, target, force=force, attachments=read_attachments(source))
    if "recovered" in recording.info:
        notify(f"{source}: {recording.info['recovered']}")
    show(Table(f"{source} to {', '.join(map(str, written))}", summary(recording)), as_json=as_json)


def _names_its_specimen_from(recording: Recording, source: Path, target: Path) -> Recording:
    """Adapt the name of a specimen file beside a recording, so that it holds from another folder."""
    named = Path(str(recording.info.get("specimen", "")))
    beside = data_file(source).parent / named
    if named.is_absolute() or not beside.is_file():
        return recording
    folder = target if target.is_dir() or not target.suffix else target.parent
    return replace(recording, info={**recording.info, "specimen": os.path.relpath(beside, folder)})

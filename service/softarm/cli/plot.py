"""``softarm plot RECORDING``: its streams over time, spectra and paths as PNG files."""

from pathlib import Path

import click

from softarm.cli.output import folder_option, json_option, notify, progress, recording_argument, show
from softarm.common.tables import Table


@click.command()
@recording_argument
@folder_option("Folder for the PNG files; by default plots/NAME.")
@json_option
def command(recording: Path, out: Path | None, as_json: bool) -> None:
    """Plot a recording: all streams over time, spectra of the motion, paths in space.

    Example: softarm plot examples/recordings/sopra_pull
    """
    from softarm.analysis.plots.recording import plot_recording
    from softarm.recordings import load_recording
    from softarm.recordings.summary import summary

    loaded = load_recording(recording)
    folder = out or Path("plots") / loaded.name
    with progress(f"plotting {loaded.name}", 3) as advance:
        written = plot_recording(loaded, folder, advance)
    show(Table(loaded.name, summary(loaded)), as_json=as_json)
    for path in written:
        notify(f"wrote {path}")

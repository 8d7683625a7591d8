"""``softarm estimate RECORDING --specimen S``: pose and external force over a recording."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softarm.cli.output import (
    FOLDER,
    NumberRange,
    force_option,
    json_option,
    notify,
    out_option,
    progress,
    recording_argument,
    show,
    specimen_option,
)
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Table

if TYPE_CHECKING:
    from collections.abc import Callable

    from softarm.analysis.offline.track import Track
    from softarm.estimator.arrays import Floats
    from softarm.estimator.calibration import CalibrationRun
    from softarm.estimator.specimen import Specimen

DEFAULT_RATE = 10.0
LINEAR_SOLVES = 60
"""Allowed to each finite-element search: under a wrong calibration it must not wander for minutes."""
NAMES = {"fem": "finite elements", "rod": "calibrated rod"}


@click.command()
@recording_argument
@specimen_option
@out_option("File or folder for the estimates: .mcap, .csv, .parquet or a folder.")
@click.option("--plots", type=FOLDER, help="Folder for the plots; by default plots/NAME beside --out.")
@click.option(
    "--rate",
    type=NumberRange(min=0.0, min_open=True),
    default=DEFAULT_RATE,
    show_default=True,
    metavar="HZ",
    help="Estimates per second of recording; readings between them are averaged.",
)
@click.option(
    "--window", type=(float, float), metavar="FROM TO", help="Use only these seconds of the recording."
)
@click.option(
    "--model",
    "kind",
    type=click.Choice(["auto", *NAMES]),
    default="auto",
    show_default=True,
    help="fem: finite elements. rod: the rod fitted to them, which is fitted first if needed. auto: the rod "
    "if it is known and accurate, otherwise the finite elements.",
)
@force_option
@json_option
def command(
    recording: Path,
    specimen: str | None,
    out: Path | None,
    plots: Path | None,
    rate: float,
    window: tuple[float, float] | None,
    kind: str,
    force: bool,
    as_json: bool,
) -> int:
    """Estimate pose and external force over a recording, with their uncertainty.

    Each instant is solved separately to the nonlinear optimum, with the recorded pressures and two unknown
    lateral forces at every rigid section. A specimen without calibration that does not predict the bends of
    a long recording is fitted to it first. The command prints a summary, writes plots and, with --out, every
    estimate.

    Example: softarm estimate examples/recordings/sopra_pull --specimen sopra
    """
    from softarm.analysis.offline.alignment import aligned
    from softarm.analysis.offline.inputs import check_and_correct, in_its_mount, load_recordings, specimen_of
    from softarm.analysis.offline.resample import resample
    from softarm.analysis.offline.result import as_recording, status_counts
    from softarm.analysis.plots.estimate import plot_track
    from softarm.estimator.calibration import arrange
    from softarm.recordings import output_file, save_recording

    beside = Path() if out is None else output_file(out, force=force).parent
    (loaded,) = load_recordings([recording], window)
    robot = in_its_mount(specimen_of(specimen, [recording], [loaded]), loaded)
    intake = check_and_correct(loaded, robot, notify)
    loaded = intake.for_estimates
    with progress(f"comparing {robot.name} with {loaded.name}") as advance:
        robot, note = aligned(robot, intake.for_fits, advance)
    if note:
        notify(note)
    run = resample(arrange(loaded, robot, tuple(section.name for section in robot.sections)), rate)
    kind = _chosen(robot) if kind == "auto" else kind
    found, surface = _on_rod(robot, run) if kind == "rod" else _on_mesh(robot, run)
    if status_counts(found)["diverged"] == len(run.time):
        raise WorkFailedError(
            f"{loaded.name}: no search converged with {NAMES[kind]}, so nothing was estimated; calibrate the "
            "specimen, or check its measures, its pressure limits and the columns of the recording"
        )
    notify(f"estimated with {NAMES[kind]}")
    if found.given_up:
        notify(
            f"the last {found.given_up} of {len(run.time)} instants were not estimated, because the searches "
            "before them did not converge: calibrate the specimen first"
        )
    show(*tables(found, loaded.name), as_json=as_json)
    folder = plots or beside / "plots" / loaded.name
    for path in plot_track(found, loaded.name, folder, surface):
        notify(f"wrote {path}")
    if out is not None:
        info = {"specimen": robot.name, "estimated_rate_hz": rate, "estimated_with": NAMES[kind]}
        for path in save_recording(as_recording(found, loaded, info), out, force=force):
            notify(f"wrote {path}")
    return 0 if bool((found.status == 0).any()) else 1


def _chosen(robot: "Specimen") -> str:
    """Choose the model: the rod where one is stored that may stand in for the finite elements."""
    from softarm.common.rods import known_trusted_rod

    return "fem" if robot.physics or known_trusted_rod(robot) is None else "rod"


def _on_mesh(robot: "Specimen", run: "CalibrationRun") -> "tuple[Track[Any], Callable[[Any], Floats]]":
    """Estimate on the finite elements, from the rod's answers where one is stored."""
    from dataclasses import replace

    from softarm.analysis.offline.track import track
    from softarm.common.rods import known_trusted_rod
    from softarm.daemon.surface import drawn_surface
    from softarm.estimator.arm import build_arm

    model = build_arm(robot)
    model = replace(model, settings=replace(model.settings, total_iterations=LINEAR_SOLVES))
    rod = known_trusted_rod(robot)
    fast_model = None if rod is None else rod.with_loads(model.loads)
    with progress(f"estimating {run.name}", len(run.time)) as advance:
        found = track(model, robot, run, advance, fast_model)
    drawn = drawn_surface(model.mesh)
    return found, lambda state: drawn.corners(model.body.points + state.displacement)


def _on_rod(robot: "Specimen", run: "CalibrationRun") -> "tuple[Track[Any], Callable[[Any], Floats]]":
    """Estimate on the calibrated rod."""
    from softarm.analysis.offline.track import track
    from softarm.common.rods import trusted_rod
    from softarm.daemon.surface import drawn_surface
    from softarm.estimator.geometry import build_mesh
    from softarm.estimator.rod.skin import skin

    with progress(f"fitting the rod of {robot.name}") as advance:
        rod = trusted_rod(robot, lambda *_: advance(1))
    with progress(f"estimating {run.name}", len(run.time)) as advance:
        found = track(rod, robot, run, advance)
    mesh = build_mesh(robot)
    drawn = drawn_surface(mesh)
    return found, lambda strain: drawn.corners(skin(mesh.points, rod.chain, strain))


def tables(found: "Track[Any]", name: str) -> tuple[Table, ...]:
    """Summarise estimates in tables: loads, sections, sensors."""
    from softarm.analysis.offline.result import force_rows, section_rows, sensor_rows, status_counts

    counts = status_counts(found)
    first, last = found.run.time[[0, -1]]
    ended = ", ".join(f"{count} {status.replace('_', ' ')}" for status, count in counts.items() if count)
    return (
        Table(
            f"{name}: external loads",
            force_rows(found),
            (
                f"{len(found.run.time)} estimates from {first:.2f} to {last:.2f} s: {ended}.",
                f"At the first: {found.statement}" if found.statement else "No search converged.",
                "The standard deviation of the estimate follows from the noise of sensors and pressures; "
                "it does not include errors of the model.",
            ),
        ),
        Table("Sections in the base frame", section_rows(found)),
        Table("Residuals of the readings", sensor_rows(found)),
    )

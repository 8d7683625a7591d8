"""``softarm calibrate RECORDING... --specimen S --out S2``: moduli, chamber gains, alignment of sensors."""

from datetime import UTC, datetime
from pathlib import Path

import click

from softarm.cli.output import (
    force_option,
    json_option,
    notify,
    out_option,
    progress,
    recordings_argument,
    show,
    specimen_option,
)


@click.command()
@recordings_argument
@specimen_option
@out_option("Specimen file to write (TOML).")
@click.option(
    "--check",
    is_flag=True,
    help="Only check whether the specimen's calibration still holds; exit status 1 if it does not.",
)
@click.option(
    "--window", type=(float, float), metavar="FROM TO", help="Use only these seconds of each recording."
)
@click.option(
    "--nodes", type=click.IntRange(8), default=160, show_default=True, help="Number of samples to fit."
)
@click.option(
    "--axes/--no-axes",
    default=None,
    help="Search for rotation and handedness of all bend axes; by default only of those not in the specimen.",
)
@force_option
@json_option
def command(
    recordings: tuple[Path, ...],
    specimen: str | None,
    out: Path | None,
    check: bool,
    window: tuple[float, float] | None,
    nodes: int,
    axes: bool | None,
    force: bool,
    as_json: bool,
) -> int:
    """Fit moduli, chamber gains and biases, alignment, gravity and cord direction to recordings.

    Pulls of a force gauge count as known forces. Alternate blocks of ten seconds, or alternate recordings,
    are held out to check the fit. Unknowns that the recordings do not determine keep their value, and
    the table names the manoeuvre that would determine them. A fit that fails the check is not written.

    Example: softarm calibrate run1 run2 --specimen sopra --out my_sopra.toml
    """
    from softarm.analysis.calibration_tables import calibration_tables, drift_table
    from softarm.analysis.offline.inputs import check_and_correct, load_recordings, specimen_of
    from softarm.estimator.arm import build_arm
    from softarm.estimator.calibration import (
        CalibrationRefusedError,
        Options,
        arrange,
        calibrate,
        calibrated_specimen,
        cautions,
        check_drift,
        most_solves,
        section_forces,
    )
    from softarm.estimator.calibration.data_quality import data_quality_notes
    from softarm.estimator.counted import counted
    from softarm.estimator.diagnosis.admit import LEAST_SAMPLES
    from softarm.estimator.errors import InputError
    from softarm.estimator.sequential_batch import SequentialBatchModel
    from softarm.estimator.specimen import require_free_specimen, save_specimen

    if check == (out is not None):
        raise click.UsageError("give either --out FILE, to calibrate, or --check")
    if out is not None:
        require_free_specimen(out, force=force)
    loaded = load_recordings(recordings, window)
    robot = specimen_of(specimen, recordings, loaded)
    samples = sum(len(recording.time) for recording in loaded)
    if samples < LEAST_SAMPLES:
        names = ", ".join(recording.name for recording in loaded)
        raise InputError(
            names,
            f"{counted(samples, 'sample')} in all, too few for a calibration",
            "record at least 20 s with changing pressures",
        )
    loaded = tuple(check_and_correct(recording, robot, notify).for_fits for recording in loaded)
    loads = section_forces(robot)
    model = build_arm(robot, loads=loads).without_snaps()
    runs = [arrange(recording, robot, model.sections, loads) for recording in loaded]
    for recording, run in zip(loaded, runs, strict=True):
        for note in data_quality_notes(recording, run):
            notify(note)
        if run.ignored_markers:
            notify(f"{run.name}: the specimen does not name markers {', '.join(run.ignored_markers)}")
    if out is None:
        with progress(f"checking {robot.name}") as advance:
            drifts = check_drift(SequentialBatchModel(model, advance), robot, runs, nodes)
        show(drift_table(drifts), as_json=as_json)
        return int(any(drift.stale for drift in drifts))
    options = Options(nodes=nodes, search_axes=axes)
    try:
        with progress(f"calibrating {robot.name}", most_solves(options)) as advance:
            found = calibrate(SequentialBatchModel(model, advance), robot, runs, options)
    except CalibrationRefusedError as refusal:
        notify(f"softarm: {refusal}")
        return 1
    provenance = f"softarm calibrate, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, {found.nodes} samples"
    save_specimen(calibrated_specimen(robot, found, provenance), out)
    show(*calibration_tables(found), as_json=as_json)
    for caution in cautions(found):
        notify(caution)
    notify(f"wrote {out}")
    return 0

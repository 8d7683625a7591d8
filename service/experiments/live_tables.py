"""Live experiments and their tables: run through the service, recorded by it, judged as recorded runs are."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.calibration import Options, arrange, calibrate, calibrated_specimen, section_forces
from estimator.recording import Recording
from estimator.sensing import SensorSuite
from estimator.specimen import Specimen, load_specimen, save_specimen
from service.cli.calibrate import tables as calibration_tables
from service.cli.output import Table
from service.experiments.campaign import tables_of, write_json
from service.experiments.force_rows import PUBLISHED, PullCase, along_cord_row, follow_pull
from service.experiments.holds import hold_windows, means
from service.experiments.live import LiveBench, live_bench
from service.experiments.live_runs import calibrate_live, force_live, teach_live, validate_live
from service.experiments.models import known_force_solver
from service.experiments.plots import plot_results
from service.experiments.seed import SeedResult, series_of
from service.experiments.teaching import TaughtPoses, miss_rows, misses, pose_of
from service.experiments.validation import pose_errors, rows
from service.recordings import save_recording

LOOK_S = 0.5
NODES = 90
WAY = "Live over zenoh; figures are of the service's recording, by the service's own estimator."


def run_live(
    name: str,
    *,
    arm: str | None,
    endpoint: str | None,
    specimen: str | None,
    out: Path,
    seed: int,
    ask: Callable[[str], None],
    advance: Callable[[], None],
) -> tuple[Table, ...]:
    """Run one experiment live and give its tables; recordings, plots and JSON go to a folder.

    Args:
        name: ``calibrate``, ``validate``, ``teach`` or ``force``.
        arm: Name of a served arm; ``None`` starts fakes.
        endpoint: Where its service listens.
        specimen: Specimen; that of the service when left out.
        out: Folder of everything.
        seed: Of the random poses.
        ask: Tells a person what to do and returns when it is done.
        advance: Called after each step.
    """
    sensors = ("pose",) if name == "teach" else ("orientation",)
    with live_bench(arm, endpoint, specimen, out, ask, sensors) as bench:
        bench.advance = advance
        done = _RUNS[name](bench, seed)
        known = bench.specimen
    result = SeedResult(seed)
    more: tuple[Table, ...] = ()
    if name == "calibrate":
        more = _calibrated(known, done, out)
    else:
        _JUDGES[name](known, done, result)
    write_json((result,), out / f"{name}.json")
    plot_results((result,), out / "plots")
    tables = tables_of((result,))
    return (*(replace(table, notes=(*table.notes, WAY)) for table in tables), *more)


def _calibrated(specimen: Specimen, recordings: tuple[Recording, ...], out: Path) -> tuple[Table, ...]:
    nominal = load_specimen(specimen.name) if specimen.calibration.recordings else specimen
    loads = section_forces(nominal)
    for recording in recordings:
        save_recording(recording, out / f"{recording.name}_with_hook", force=True)
    runs = [arrange(recording, nominal, None, loads) for recording in recordings]
    found = calibrate(known_force_solver(nominal), nominal, runs, Options(nodes=NODES, iterations=8))
    told = f"softarm experiment calibrate, {', '.join(run.name for run in runs)}"
    save_specimen(calibrated_specimen(nominal, found, told), out / "specimen.toml")
    return calibration_tables(found)


def _validated(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    run = arrange(recordings[0], specimen, None, section_forces(specimen))
    holds = means(run, hold_windows(recordings[0]))
    errors = pose_errors(known_force_solver(specimen), specimen, holds)
    result.add("validation", rows(errors, "held out"))
    last = errors[-1]
    result.series["validation"] = {"mm": last.millimetres.tolist(), "degrees": last.degrees.tolist()}


def _forced(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    for condition, recording in zip(PUBLISHED, recordings, strict=True):
        at_rest = condition == "not pressurised"
        done = follow_pull(PullCase(condition, recording, specimen), at_rest=at_rest)
        result.add("force", [along_cord_row(done, PUBLISHED[condition])])
        result.series[f"force {condition}"] = series_of(done)


def _taught(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    recording = recordings[0]
    run = arrange(recording, specimen)
    sensor, readings = pose_of(run, "tip")
    suite = SensorSuite((sensor,))
    posed = replace(run, suite=suite, readings=readings)
    looks = np.array(recording.info["looks"]).reshape(2, -1)
    shown, held = (
        means(posed, np.column_stack([ends - LOOK_S, ends])).readings for ends in (looks[0], looks[1])
    )
    millimetres, degrees = misses(TaughtPoses(suite, shown, looks[0]), held)
    reachable = np.array(recording.info["reachable"], dtype=bool)
    result.add("teach", miss_rows("held with feedback", millimetres, degrees))
    if reachable.any() and not reachable.all():
        label = "of these, told reachable"
        result.add("teach", miss_rows(label, millimetres[reachable], degrees[reachable]))
    result.series["teach"] = {"mm_0": millimetres.tolist(), "degrees_0": degrees.tolist()}
    result.notes.append(f"{len(held)} poses, {int(reachable.sum())} told reachable.")


def _teach(bench: LiveBench, seed: int) -> tuple[Recording, ...]:
    taught = teach_live(bench, seed)
    told = {
        "looks": [list(taught.shown), list(taught.held)],
        "reachable": list(taught.reachable),
    }
    return (replace(taught.recording, info={**taught.recording.info, **told}),)


_RUNS: Mapping[str, Callable[[LiveBench, int], tuple[Recording, ...]]] = {
    "calibrate": calibrate_live,
    "validate": lambda bench, seed: (validate_live(bench, seed),),
    "force": lambda bench, seed: force_live(bench),  # noqa: ARG005
    "teach": _teach,
}
_JUDGES: Mapping[str, Callable[[Specimen, tuple[Recording, ...], SeedResult], None]] = {
    "validate": _validated,
    "force": _forced,
    "teach": _taught,
}

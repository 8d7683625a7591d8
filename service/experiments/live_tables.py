"""Live experiments and their tables: run through the service, recorded by it, judged as recorded runs are."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.calibration import Options, Run, arrange, calibrate, calibrated_specimen, section_forces
from estimator.calibration.complaints import complaints
from estimator.recording import Recording
from estimator.sensing import SensorSuite
from estimator.specimen import Specimen, load_specimen, save_specimen
from service.cli.calibrate import tables as calibration_tables
from service.cli.output import Table
from service.experiments.campaign import tables_of, write_json
from service.experiments.force_rows import PullCase, along_cord_row, follow_pull
from service.experiments.holds import hold_windows, means
from service.experiments.live import LiveBench, live_bench
from service.experiments.live_runs import calibrate_live, force_live, teach_live, validate_live
from service.experiments.models import known_force_solver
from service.experiments.paper import FORCE_N
from service.experiments.plots import plot_results
from service.experiments.seed import SeedResult, series_of
from service.experiments.teaching import TaughtPoses, miss_rows, misses, pose_of
from service.experiments.validation import pose_errors, rows
from service.recordings import save_recording

Floats = NDArray[np.float64]

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
    for recording in done:
        save_recording(recording, out / "recordings" / recording.name, force=True)
    result = SeedResult(seed)
    more: tuple[Table, ...] = ()
    if name == "calibrate":
        more = _calibrated(known, done, out, advance)
    else:
        _JUDGES[name](known, done, result)
    write_json((result,), out / f"{name}.json")
    plot_results((result,), out / "plots")
    tables = tables_of((result,))
    return (*(replace(table, notes=(*table.notes, WAY)) for table in tables), *more)


def _calibrated(
    specimen: Specimen, recordings: tuple[Recording, ...], out: Path, advance: Callable[[], None]
) -> tuple[Table, ...]:
    nominal = load_specimen(specimen.name) if specimen.calibration.recordings else specimen
    loads = section_forces(nominal)
    runs = [arrange(recording, nominal, None, loads) for recording in recordings]
    lacking = [told for pair in zip(recordings, runs, strict=True) for told in complaints(*pair)]
    solver = known_force_solver(nominal, lambda _: advance())
    found = calibrate(solver, nominal, runs, Options(nodes=NODES, iterations=8))
    told = f"softarm experiment calibrate, {', '.join(run.name for run in runs)}"
    save_specimen(calibrated_specimen(nominal, found, told), out / "specimen.toml")
    first, *others = calibration_tables(found)
    written = f"Written to {out / 'specimen.toml'}."
    return (replace(first, notes=(*first.notes, *lacking, WAY, written)), *others)


def _validated(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    run = arrange(recordings[0], specimen, None, section_forces(specimen))
    holds = means(run, hold_windows(recordings[0]))
    errors = pose_errors(known_force_solver(specimen), specimen, holds)
    result.add("validation", rows(errors, "held out"))
    last = errors[-1]
    result.series["validation"] = {"mm": last.millimetres.tolist(), "degrees": last.degrees.tolist()}


def _forced(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    for condition, recording in zip(FORCE_N, recordings, strict=True):
        at_rest = condition == "not pressurised"
        done = follow_pull(PullCase(condition, recording, specimen), at_rest=at_rest)
        result.add("force", [along_cord_row(done, FORCE_N[condition])])
        result.series[f"force {condition}"] = series_of(done)


def _taught(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    recording = recordings[0]
    run = arrange(recording, specimen)
    sensor, readings = pose_of(run, "tip")
    suite = SensorSuite((sensor,))
    posed = replace(run, suite=suite, readings=readings)
    looks = np.array(recording.info["looks"]).reshape(2, -1)
    shown, held = (np.array([_pose_before(posed, end) for end in ends]) for ends in looks)
    seen = np.isfinite(shown).all(axis=1) & np.isfinite(held).all(axis=1)
    shown, held = shown[seen], held[seen]
    millimetres, degrees = misses(TaughtPoses(suite, shown, looks[0][seen]), held)
    reachable = np.array(recording.info["reachable"], dtype=bool)[seen]
    result.add("teach", miss_rows("held with feedback", millimetres, degrees))
    if reachable.any() and not reachable.all():
        label = "of these, told reachable"
        result.add("teach", miss_rows(label, millimetres[reachable], degrees[reachable]))
    result.series["teach"] = {"mm_0": millimetres.tolist(), "degrees_0": degrees.tolist()}
    lost = f", {int((~seen).sum())} left out: not seen while shown or held" if not seen.all() else ""
    result.notes.append(f"{len(held)} poses, {int(reachable.sum())} told reachable{lost}.")


def _pose_before(run: Run, end: float) -> Floats:
    """Give the mean pose of a look that ends then, NaN where nothing was seen, shape (7,)."""
    seen = means(run, np.array([[end - LOOK_S, end]])).readings
    return seen[0] if len(seen) else np.full(run.readings.shape[1], np.nan)


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

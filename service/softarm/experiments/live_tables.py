"""Live experiments and their tables: run through the service, recorded by it, judged as recorded runs are."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softarm.analysis.calibration_tables import calibration_tables
from softarm.common.tables import Table
from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import (
    CalibrationRun,
    Options,
    arrange,
    calibrate,
    calibrated_specimen,
    section_forces,
)
from softarm.estimator.calibration.data_quality import data_quality_notes
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen, save_specimen
from softarm.experiments.campaign import summary, tables_of, write_json
from softarm.experiments.force_rows import PullCase, along_cord_row, follow_pull
from softarm.experiments.holds import hold_windows, means
from softarm.experiments.live import LiveRig, LiveRigSettings, live_rig
from softarm.experiments.live_runs import calibrate_live, force_live, teach_live, validate_live
from softarm.experiments.models import known_force_model
from softarm.experiments.paper import FORCE_N
from softarm.experiments.plots import plot_prediction, plot_results
from softarm.experiments.seed import SeedResult, series_of
from softarm.experiments.teaching import miss_rows, misses, pose_of
from softarm.experiments.validation import pose_errors, rows
from softarm.recordings import save_recording

WINDOW_S = 0.5
NODES = 90
DRAWING = "sopra"
SPECIMEN = "specimen.toml"
PULLED = ("calibrate", "force")
SAME = ("seed", "sensors", "unknown_loads", "paper_mean_n", "paper_max_n")
WAY = "Live over zenoh; figures are of the service's recording, by the service's own estimator."


@dataclass(frozen=True)
class ExperimentInteraction:
    """How a live experiment communicates with whoever started it.

    Args:
        ask: Shows a person what to do and returns when it is done.
        notify: Reports what was recorded before the rest is done.
        advance: Called after each step.
    """

    ask: Callable[[str], None]
    notify: Callable[[str], None]
    advance: Callable[[], None]


def run_live_arms(
    name: str, settings: LiveRigSettings, count: int, interaction: ExperimentInteraction
) -> tuple[Table, ...]:
    """Run one experiment on several fake arms, each calibrated first as in a laboratory; join the tables.

    Args:
        name: ``validate``, ``teach`` or ``force``; or ``calibrate``, which is then all that is done.
        settings: Where; each arm has a folder of its own in that of ``settings``.
        count: Number of arms; they are drawn with tolerances of their own.
        interaction: How it communicates with whoever started it.
    """
    results, tables = list[SeedResult](), list[Table]()
    for number in range(1, count + 1):
        arm_settings = replace(settings, out=settings.out / f"seed{number}", variant=number)
        if settings.specimen is None and name != "calibrate":
            run_live("calibrate", arm_settings, number, interaction)
            arm_settings = replace(arm_settings, specimen=str(arm_settings.out / SPECIMEN))
        arm_tables, result = run_live(name, arm_settings, number, interaction)
        results.append(result)
        tables += arm_tables
    if name == "calibrate":
        return tuple(tables)
    write_json(results, settings.out / f"{name}.json", WAY)
    plot_results(results, settings.out / "plots")
    return summary(results, WAY), *tables_of(results)


def run_live(
    name: str, settings: LiveRigSettings, seed: int, interaction: ExperimentInteraction
) -> tuple[tuple[Table, ...], SeedResult]:
    """Run one experiment live and return its tables; recordings, plots and JSON go to a folder.

    Args:
        name: ``calibrate``, ``validate``, ``teach`` or ``force``.
        settings: Where it runs; a fake arm is calibrated from its drawing where no specimen is named.
        seed: Of the random poses.
        interaction: How it communicates with whoever started it.
    """
    sensors = ("pose",) if name == "teach" else ("orientation",)
    out = settings.out
    if name == "calibrate" and settings.arm is None and settings.specimen is None:
        settings = replace(settings, specimen=DRAWING)
    with live_rig(settings, interaction.ask, sensors) as rig:
        rig.advance = interaction.advance
        for lost in rig.lost():
            interaction.notify(lost)
        if name in PULLED:
            rig.require_gauge()
        done = _RUNS[name](rig, seed)
        specimen = rig.specimen
    kept = [str(save_recording(r, out / "recordings" / r.name, force=True)[0].parent) for r in done]
    interaction.notify(f"recorded: {', '.join(kept)}")
    result, plots = SeedResult(seed), out / "plots"
    if name == "calibrate":
        tables = _calibrated(specimen, done, out, interaction.advance)
        result.tables = {table.title: list(map(dict, table.rows)) for table in tables}
        plot_prediction(tables[-1].rows, plots / "calibration.png")
    else:
        _EVALUATIONS[name](specimen, done, result)
        tables = tuple(_alone(table, seed) for table in tables_of((result,)))
        plot_results((result,), plots)
    write_json((result,), out / f"{name}.json", WAY)
    notes = (*data_quality_notes_of(specimen, done), WAY)
    return (*tables[:-1], replace(tables[-1], notes=(*tables[-1].notes, *notes))), result


def _alone(table: Table, seed: int) -> Table:
    """Leave out what does not differ on one arm; the first row has all headings that are left."""
    names = [name for name in dict.fromkeys(n for row in table.rows for n in row) if name not in SAME]
    notes = tuple(note.removeprefix(f"Seed {seed}: ") for note in table.notes)
    return replace(table, rows=[{name: row.get(name) for name in names} for row in table.rows], notes=notes)


def data_quality_notes_of(specimen: Specimen, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Name what the recordings lack."""
    loads = section_forces(specimen)
    return tuple(
        note for r in recordings for note in data_quality_notes(r, arrange(r, specimen, None, loads))
    )


def _calibrated(
    specimen: Specimen, recordings: Sequence[Recording], out: Path, advance: Callable[[], None]
) -> tuple[Table, ...]:
    loads = section_forces(specimen)
    runs = [arrange(recording, specimen, None, loads) for recording in recordings]
    solver = known_force_model(specimen, lambda _: advance())
    outcome = calibrate(solver, specimen, runs, Options(nodes=NODES, iterations=8))
    provenance = f"softarm experiment calibrate, {', '.join(run.name for run in runs)}"
    save_specimen(calibrated_specimen(specimen, outcome, provenance), out / SPECIMEN)
    return calibration_tables(outcome)


def _validated(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    run = arrange(recordings[0], specimen, None, section_forces(specimen))
    pose_of(run, specimen.sections[-1].name)  # the paper's figures are of the tip
    holds = means(run, hold_windows(recordings[0]))
    errors = pose_errors(known_force_model(specimen), specimen, holds)
    result.add("validation", rows(errors, "held out"))
    last = errors[-1]
    result.series["validation"] = {"mm": last.millimetres.tolist(), "degrees": last.degrees.tolist()}


def _forced(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    for condition, recording in zip(FORCE_N, recordings, strict=True):
        at_rest = condition == "not pressurised"
        done = follow_pull(PullCase(condition, recording, specimen), at_rest=at_rest)
        result.add("force", [along_cord_row(done, FORCE_N[condition])])
        result.series[f"force {condition}"] = series_of(done)


def evaluate_taught(specimen: Specimen, recordings: tuple[Recording, ...], result: SeedResult) -> None:
    """Compare the tip while poses were shown and while they were held, as ``teach_live`` recorded it."""
    recording = recordings[0]
    posed = pose_of(arrange(recording, specimen), "tip")
    looks = np.array(recording.info["looks"]).reshape(2, -1)
    shown, held = (np.array([_pose_before(posed, end) for end in ends]) for ends in looks)
    valid = np.isfinite(shown).all(axis=1) & np.isfinite(held).all(axis=1)
    shown, held = shown[valid], held[valid]
    millimetres, degrees = misses(shown, held)
    answers = list(zip(recording.info["limits"], recording.info["reachable"], strict=True))
    reachable = np.array(recording.info["reachable"], dtype=bool)[valid]
    result.add("teach", miss_rows("held with feedback", millimetres, degrees))
    if reachable.any() and not reachable.all():
        label = "of these, called reachable"
        result.add("teach", miss_rows(label, millimetres[reachable], degrees[reachable]))
    result.series["teach"] = {"mm_0": millimetres.tolist(), "degrees_0": degrees.tolist()}
    lost = f", {int((~valid).sum())} left out: not seen while shown or held" if not valid.all() else ""
    counted = f"{len(held)} poses; the service called {int(reachable.sum())} of them reachable"
    result.notes.append(f"{counted} to within the sensors' noise{lost}.")
    far = [f"{k}: {note}" for k, (note, can) in enumerate(answers, 1) if not can]
    if far:
        result.notes.append(f"Of the poses, {' '.join(far)}")


def _pose_before(run: CalibrationRun, end: float) -> Floats:
    """Return the mean pose of the window that ends then, NaN where nothing was seen, shape (7,)."""
    mean = means(run, np.array([[end - WINDOW_S, end]])).readings
    return mean[0] if len(mean) else np.full(run.readings.shape[1], np.nan)


_RUNS: Mapping[str, Callable[[LiveRig, int], tuple[Recording, ...]]] = {
    "calibrate": calibrate_live,
    "validate": validate_live,
    "force": lambda rig, seed: force_live(rig),  # noqa: ARG005
    "teach": teach_live,
}
_EVALUATIONS: Mapping[str, Callable[[Specimen, tuple[Recording, ...], SeedResult], None]] = {
    "validate": _validated,
    "force": _forced,
    "teach": evaluate_taught,
}

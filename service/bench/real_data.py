"""``softarm bench real-data``: calibrate on real recordings, predict what no fit has seen."""

import os
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from estimator.arm import build_arm
from estimator.calibration import (
    NodeSolver,
    Options,
    Run,
    Solver,
    arrange,
    calibrate,
    calibrated_specimen,
)
from estimator.calibration.nodes import block_of, training_blocks
from estimator.calibration.regression import fit_line
from estimator.errors import InputError
from estimator.model import Inputs
from estimator.recording import Floats, Recording
from estimator.sensing import Registration, Scene
from estimator.sensors import SpecimenSensors
from estimator.specimen import Specimen, load_specimen
from service.cli.output import Cell, Table, as_markdown, json_option, progress, quick_option, show
from service.offline.inputs import cut, load_recordings
from service.offline.resample import resample
from service.offline.track import track

BESIDE = Path(__file__).parents[3] / "shared" / "recordings"
ARM = "sopra_2021-07-09"
BARE, LOADED = "beam_gravity_v2_a", "beam_load52_v2_a"
HELD = (0.15, 0.6)  # s, while the beam is held level
SETTLED = 1.0  # s before the end, when the swing has died away
RATE = 10.0  # Hz of the predictions
"""Recordings and the parts of them that count."""


@click.command()
@json_option
@quick_option
@click.option("--markdown", is_flag=True, help="Print the tables for a page of the documentation.")
def command(as_json: bool, quick: bool, markdown: bool) -> None:
    """Calibrate on real recordings and predict what was held out: the SoPrA arm, the silicone beam.

    Reads the development recordings beside the checkout, or those that SOFTARM_RECORDINGS names.

    Example: softarm bench real-data --json
    """
    folder = recordings_folder()
    with progress("the beam") as advance:
        beam = beam_tables(folder, advance)
    with progress("the arm") as advance:
        arm = arm_tables(folder, 40 if quick else 120, advance)
    if markdown:
        click.echo(as_markdown(*arm, *beam))
    else:
        show(*arm, *beam, as_json=as_json)


def recordings_folder() -> Path:
    """Find the development recordings.

    Raises:
        InputError: They are not there.
    """
    folder = Path(os.environ.get("SOFTARM_RECORDINGS", BESIDE))
    if not (folder / ARM).is_dir():
        raise InputError(
            str(folder), f"holds no {ARM}", "set SOFTARM_RECORDINGS to the folder of the recordings"
        )
    return folder


@dataclass(frozen=True)
class ArmErrors:
    """Errors [rad] of a model and of a line on blocks, by component of each bend.

    Args:
        names: Components.
        line_training: Of the line on the blocks that it was fitted on.
        line: Of the line on the others.
        training: Of the model on the blocks that it was fitted on.
        model: Of the model on the others.
    """

    names: tuple[str, ...]
    line_training: Floats
    line: Floats
    training: Floats
    model: Floats


def arm_tables(folder: Path, nodes: int, advance: Callable[[float], None]) -> tuple[Table, ...]:
    """Calibrate the SoPrA arm on alternate blocks of ten seconds and predict the others."""
    specimen = load_specimen("sopra")
    (recording,) = load_recordings([folder / ARM])
    model = build_arm(specimen, loads=())
    run = arrange(recording, specimen, model.sections)
    solver = NodeSolver(model, advance)
    train = run.window(training_blocks(block_of(run, run.time)))
    found = calibrate(solver, specimen, [train], Options(nodes=nodes))
    errors = arm_errors(solver, recording, run, calibrated_specimen(specimen, found))
    rows: list[dict[str, Cell]] = []
    for index, name in enumerate(errors.names):
        rows.append(_error_row(name, *(part[index] for part in _parts(errors))))
    rows.append(_error_row("all", *(float(np.sqrt((part**2).mean())) for part in _parts(errors))))
    unknowns: list[dict[str, Cell]] = [
        {
            "unknown": entry.parameter.name,
            "value": float(np.exp(entry.value)) if entry.parameter.kind == "modulus" else entry.value,
            "std": entry.std,
            "unit": "factor" if entry.parameter.kind == "modulus" else entry.parameter.unit,
            "verdict": entry.verdict,
        }
        for entry in found.identified
    ]
    return (
        Table(
            f"{ARM}: rms error of the bends [degrees]",
            rows,
            (
                "Fitted on blocks 0, 2, 4, 6 of ten seconds, judged on blocks 1, 3, 5, 7, at "
                f"{RATE:g} samples per second.",
                f"Line: ordinary linear regression of six pressures (and an offset) to four angles, "
                f"{7 * len(errors.names)} numbers. Model: finite elements, {found.fitted} numbers.",
            ),
        ),
        Table(f"{ARM}: what the model was fitted with", unknowns),
    )


def arm_errors(solver: Solver, recording: Recording, run: Run, calibrated: Specimen) -> ArmErrors:
    """Compare a calibrated model and a line on training and on held-out blocks."""
    train = training_blocks(block_of(run, run.time))
    line = fit_line(run.pressures[train], run.readings[train])
    slow = resample(arrange(recording, calibrated, solver.sections), RATE)
    seen = training_blocks(block_of(run, slow.time))
    left = slow.readings - predict(solver, calibrated, slow)
    by_line = slow.readings - line.predict(slow.pressures)
    names = tuple(f"{m.name} {axis}" for m in run.suite.measurements for axis in "xy")
    return ArmErrors(names, _rms(by_line[seen]), _rms(by_line[~seen]), _rms(left[seen]), _rms(left[~seen]))


def predict(solver: Solver, calibrated: Specimen, run: Run) -> Floats:
    """Give the readings of a run that a calibrated specimen predicts, shape (samples, readings)."""
    acting = (
        SpecimenSensors(calibrated, solver.sections, Registration()).actuation().to_chamber(run.pressures)
    )
    scales = {name: value.value for name, value in calibrated.calibration.modulus_scale.items()}
    loads = np.zeros((len(acting), len(solver.loads)))
    found = solver.respond(scales, acting, loads, np.array(calibrated.gravity_m_s2), None)
    readings = run.suite.predict(Scene(found.frames, np.zeros((len(run.time), 0))))
    return np.where(found.converged[:, None], readings, np.nan)


def beam_tables(folder: Path, advance: Callable[[float], None]) -> tuple[Table, ...]:
    """Find the bare beam's modulus from its sag and predict the loaded beam with it."""
    specimen = load_specimen("beam")
    (bare,) = load_recordings([folder / BARE])
    model = build_arm(specimen)
    options = Options(fit_lag=False)
    runs = [arrange(cut(bare, settled(bare)), specimen, model.sections)]
    found = calibrate(NodeSolver(model.with_loads(()), advance), specimen, runs, options)
    calibrated = calibrated_specimen(specimen, found)
    scale = calibrated.calibration.modulus_scale["upper"]
    young = specimen.materials[specimen.segments[0].material].young
    rows = [_beam_row(folder / name, calibrated, advance) for name in (BARE, LOADED)]
    changes = [_number(row, "force_settled_n") - _number(row, "force_held_n") for row in rows]
    rows = [
        {**row, "weight_estimated_n": changes[0] - change} for row, change in zip(rows, changes, strict=True)
    ]
    return (
        Table(
            "Silicone beam: calibrated on the settled bare beam",
            [
                {
                    "young_kpa": young * scale.value / 1e3,
                    "std_kpa": young * scale.std / 1e3,
                    "owners_kpa": 264.0,
                }
            ],
        ),
        Table(
            "Silicone beam: from held level to settled",
            rows,
            (
                "Drop of the tip: by its markers, and by the model with the weight known to hang there.",
                "Forces at the tip along x (up): estimated from the motion alone.",
                "Weight: the change of that force from held to settled, less that of the bare beam.",
            ),
        ),
    )


def settled(recording: Recording) -> tuple[float, float]:
    """Give the window at the end in which the swing has died away [s]."""
    end = float(recording.time[-1])
    return end - SETTLED, end


def _beam_row(folder: Path, calibrated: Specimen, advance: Callable[[float], None]) -> dict[str, Cell]:
    (recording,) = load_recordings([folder])
    truth = tomllib.loads((folder / "truth.toml").read_text())["tip_load_n"]
    model = build_arm(calibrated)
    tip = model.sections.index("tip")
    ends = []
    for window in (HELD, settled(recording)):
        run = resample(arrange(cut(recording, window), calibrated, model.sections), RATE)
        ends.append(track(model, calibrated, run, advance))
    held, rest = (np.nanmean(end.frames.positions[:, tip, 0]) for end in ends)
    forces = [float(np.nanmean(end.forces[:, 0])) for end in ends]
    gravity = np.array(calibrated.gravity_m_s2)
    level = float(np.nanmean(ends[0].forces[:, 0]))
    drops = []
    for force in (level, -truth):
        state, _ = model.solve(Inputs(np.zeros(0), np.array([force, 0.0]), gravity), model.rest())
        drops.append(model.section_frames(state).positions[tip, 0])
    return {
        "recording": recording.name,
        "drop_measured_mm": (held - rest) * 1e3,
        "drop_predicted_mm": (drops[0] - drops[1]) * 1e3,
        "force_held_n": forces[0],
        "force_settled_n": forces[1],
        "weight_known_n": truth,
        "std_of_force_n": float(np.nanmedian(ends[1].force_std[:, 0])),
    }


def _number(row: dict[str, Cell], heading: str) -> float:
    value = row[heading]
    assert isinstance(value, float)
    return value


def _parts(errors: ArmErrors) -> tuple[Floats, Floats, Floats, Floats]:
    return errors.line_training, errors.line, errors.training, errors.model


def _error_row(
    name: str, line_training: float, line: float, training: float, model: float
) -> dict[str, Cell]:
    return {
        "angle": name,
        "line_on_its_blocks": float(np.degrees(line_training)),
        "line_held_out": float(np.degrees(line)),
        "model_on_its_blocks": float(np.degrees(training)),
        "model_held_out": float(np.degrees(model)),
    }


def _rms(left: Floats) -> Floats:
    """Give the root mean square of each column, lost samples left out."""
    values: Floats = np.sqrt(np.nanmean(left**2, axis=0))
    return values

"""``softarm bench step``: what a step of the estimator costs, in parts and as a whole."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import click
import numpy as np
from scipy.sparse.linalg import splu

from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm.estimator.arm import model_on_mesh
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.linalg.cholesky import CholeskyPlan, FactorPlan
from softarm.estimator.fem.linalg.pardiso import PardisoPlan
from softarm.estimator.fem.linalg.symbolic import analyse
from softarm.estimator.fem.tracking import BackgroundFactorisation, TrackingModel
from softarm.estimator.fem.tracking.frozen_tangent import freeze_tangent
from softarm.estimator.geometry import DEFAULTS, build_mesh
from softarm.estimator.inverse import (
    Estimator,
    InputBounds,
    LoadProcess,
    Tolerances,
    TrackerSettings,
    Unknowns,
)
from softarm.estimator.inverse.objectives import Iterate, SensorObjective
from softarm.estimator.inverse.program import build_program, solve_program
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import Specimen, load_specimen

RATE_HZ = 100.0
NOISE_RAD = np.radians(0.1)
NOISE_PA = 200.0
REPEATS = 40
SOLVER_NOTES = (
    "Solution: for all inputs. Ratio: factor and solution over those of the multifrontal factor. One thread.",
)


@dataclass(frozen=True)
class TimedRun:
    """A motion of the arm with what sensors see of it.

    Args:
        inputs: True inputs at each instant.
        readings: Noise-free readings, shape (samples, readings).
    """

    inputs: tuple[Inputs, ...]
    readings: Floats


def motion(model: FiniteElementModel, suite: SensorSuite, gravity: Floats, samples: int) -> TimedRun:
    """Move the arm slowly by pressures up to 24 kPa and forces up to 0.25 N at each section."""
    state, inputs, readings = model.rest(), [], []
    for k in range(samples):
        t = k / RATE_HZ
        pressures = 1.2e4 * (1.0 - np.cos(0.8 * t + np.arange(model.chambers) * 2.0))
        loads = 0.25 * np.sin(0.9 * t + np.arange(len(model.loads)))
        sample = Inputs(pressures, loads, gravity)
        state, _ = model.solve(sample, state)
        frames = model.linearise(state, sample).frames
        inputs.append(sample)
        readings.append(suite.predict(frames))
    return TimedRun(tuple(inputs), np.array(readings))


def milliseconds(work: Callable[[], Any], repeats: int = REPEATS) -> Floats:
    """Time calls by the processor time of this thread [ms], after one that is not counted."""
    work()
    spent = np.empty(repeats)
    for k in range(repeats):
        begin = time.thread_time()
        work()
        spent[k] = 1e3 * (time.thread_time() - begin)
    return spent


def figures(spent: Floats) -> dict[str, Cell]:
    """Return the median and the 99th percentile."""
    return {"median_ms": float(np.median(spent)), "p99_ms": float(np.percentile(spent, 99))}


def parts(model: FiniteElementModel, suite: SensorSuite, run: TimedRun) -> list[dict[str, Cell]]:
    """Time the parts of a step at one instant of the motion."""
    inputs = run.inputs[0]
    state, _ = model.solve(inputs, model.rest())
    tangent = model.balance(state.displacement, inputs).evaluation.tangent
    assert tangent is not None
    plan = model.body.plan
    step = model.linearise(state, inputs)
    forces = step.input_forces()
    assert step.factor is not None
    factor = step.factor
    objective = SensorObjective(suite, run.readings[0])
    unknowns = Unknowns.of(model.chambers, model.loads)
    vector = unknowns.vector(inputs)
    rows = (objective.rows(Iterate(step.frames, vector, model.chambers, step.response)),)
    program = build_program(rows, InputBounds.free(unknowns.size), vector, unknowns.scale, 1.0)
    cases: list[tuple[str, Callable[[], Any]]] = [
        ("residual", lambda: model.balance(state.displacement, inputs, tangent=False)),
        ("residual and tangent", lambda: model.balance(state.displacement, inputs)),
        ("factor", lambda: plan.factorise(tangent)),
        (f"{len(forces)} right-hand sides", lambda: factor.solve(forces)),
        ("factor and responses", lambda: freeze_tangent(model, state.displacement, inputs)),
        (f"quadratic program, {unknowns.size} unknowns", lambda: solve_program(program)),
    ]
    return [{"part": name, **figures(milliseconds(work))} for name, work in cases]


def follow(
    estimator: Estimator[Any, Any], run: TimedRun, noise: int | None
) -> tuple[dict[str, Cell], Floats]:
    """Run an estimator along a motion.

    Returns:
        Its figures, and the processor time of this thread at each instant but the first ten [ms].
    """
    random = np.random.default_rng(noise)
    spent, errors, iterations, converged = [], [], [], 0
    for k, inputs in enumerate(run.inputs):
        readings, pressures = run.readings[k], inputs.pressures
        if noise is not None:
            readings = readings + NOISE_RAD * random.standard_normal(readings.shape)
            pressures = pressures + NOISE_PA * random.standard_normal(pressures.shape)
        begin = time.thread_time()
        estimate = estimator.update(k / RATE_HZ, readings, pressures, inputs.gravity)
        spent.append(1e3 * (time.thread_time() - begin))
        errors.append(estimate.inputs.loads - inputs.loads)
        iterations.append(estimate.iterations)
        converged += estimate.converged
    kept = np.array(spent[10:])
    cells: dict[str, Cell] = {
        **figures(kept),
        "rate_hz": 1e3 / float(np.median(kept)),
        "linearisations": float(np.mean(iterations[10:])),
        "converged_percent": 100.0 * converged / len(run.inputs),
        "force_error_mn": 1e3 * float(np.sqrt(np.mean(np.square(errors[10:])))),
    }
    return cells, kept


def steps(
    specimen: Specimen,
    model: FiniteElementModel,
    suite: SensorSuite,
    run: TimedRun,
    done: Callable[[float], None],
) -> list[dict[str, Cell]]:
    """Follow the motion by every scheme, without and with noise."""
    table: list[dict[str, Cell]] = []
    schemes = (
        ("one linearisation, fresh factor", True, False, Tolerances(iterations=1)),
        ("converged, a factor for every linearisation", True, False, None),
        ("converged, factor reused until it slows", False, False, None),
        ("converged, factor refreshed in the background", False, True, None),
    )
    for name, exact, background, tolerances in schemes:
        for noise in (None, 1):
            settings = tracker_settings(specimen, model, tolerances)
            with BackgroundFactorisation(model) if background else nullcontext() as thread:
                followed: Any = model if exact else TrackingModel(model, thread)
                cells, _ = follow(Estimator(followed, suite, settings), run, noise)
            table.append({"scheme": name, "noise": noise is not None, **cells})
            done(1)
    return table


def tracker_settings(
    specimen: Specimen, model: FiniteElementModel, tolerances: Tolerances | None = None
) -> TrackerSettings:
    """Make the settings of the estimators that follow the motion."""
    actuation = SpecimenSensors(specimen, model.sections, Registration()).actuation()
    process = LoadProcess(np.full(len(model.loads), 1.0), 0.5)
    return TrackerSettings(process, actuation, np.array(specimen.pressure_limits), tolerances=tolerances)


def solvers(model: FiniteElementModel, displacement: Floats, inputs: Inputs) -> list[dict[str, Cell]]:
    """Time the factor of a tangent and its solution for all inputs by each solver, in turn.

    The last column is the sum of both medians over that of the multifrontal factor.
    """
    tangent = model.balance(displacement, inputs).evaluation.tangent
    assert tangent is not None
    pattern, body = model.body.pattern, model.body
    matrix = pattern.matrix(tangent.values, tangent.mirror)
    forces = model.linearise(FiniteElementState(displacement, inputs), inputs).input_forces()
    plans = {"multifrontal": FactorPlan(pattern, CholeskyPlan.of(analyse(pattern, body.ordering)))}
    if (pardiso := PardisoPlan.of(pattern)) is not None:
        plans["PARDISO"] = FactorPlan(pattern, pardiso)
    work: dict[str, Callable[[], tuple[float, float]]] = {
        name: lambda plan=plan: _timed(lambda: plan.factorise(tangent), lambda f: f.solve(forces))  # type: ignore[misc]
        for name, plan in plans.items()
    }
    work["SuperLU"] = lambda: _timed(lambda: splu(matrix), lambda f: f.solve(forces.T))
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for repeat in range(REPEATS + 1):
        for name, measure in work.items():
            if name != "SuperLU" or repeat <= REPEATS // 8 + 1:
                spent[name].append(measure())
    reference = np.median(np.array(spent["multifrontal"][1:]), axis=0).sum()
    return [_solver_row(name, np.array(times[1:]), float(reference)) for name, times in spent.items()]


def _timed(factorise: Callable[[], Any], solve: Callable[[Any], Any]) -> tuple[float, float]:
    """Time a factor and its solution by the processor time of this thread [ms]."""
    begin = time.thread_time()
    factor = factorise()
    middle = time.thread_time()
    solve(factor)
    return 1e3 * (middle - begin), 1e3 * (time.thread_time() - middle)


def _solver_row(name: str, times: Floats, reference: float) -> dict[str, Cell]:
    factor, solution = np.median(times, axis=0).tolist()
    return {
        "solver": name,
        "factor_ms": factor,
        "factor_p99_ms": float(np.percentile(times[:, 0], 99)),
        "solution_ms": solution,
        "ratio": (factor + solution) / reference,
    }


@click.command()
@click.option("--specimen", "name", default="sopra", show_default=True, help="Specimen to solve.")
@quick_option
@json_option
def command(name: str, quick: bool, as_json: bool) -> int:
    """Time a step of the estimator, part by part.

    The benchmark measures the processor time of the calling thread, so that other programs disturb it little;
    the work of the background thread is not included. The arm moves all the while, with an estimate every
    10 ms. The sensors are two orientations and all pressures; four forces are unknown. Every scheme but the
    first iterates to the nonlinear optimum.

    Example: softarm bench step --quick
    """
    specimen = load_specimen(name)
    mesh = build_mesh(specimen, DEFAULTS[specimen.geometry.kind])
    model = model_on_mesh(specimen, mesh)
    suite = orientations(specimen, model.sections)
    run = motion(model, suite, np.array(specimen.gravity_m_s2), 40 if quick else 200)
    state, _ = model.solve(run.inputs[0], model.rest())
    title = f"{specimen.name}, {len(mesh.points)} nodes"
    notes = (
        f"Noise: {np.degrees(NOISE_RAD):.1f} degrees and {NOISE_PA:.0f} Pa, white. "
        "force error: root mean square over the four forces.",
    )
    with progress("Timing", 8) as advance:
        tables = (
            Table(f"{title}: parts", parts(model, suite, run)),
            Table(f"{title}: solvers", solvers(model, state.displacement, run.inputs[0]), SOLVER_NOTES),
            Table(f"{title}: steps", steps(specimen, model, suite, run, advance), notes),
        )
    show(*tables, as_json=as_json)
    return 0


def orientations(specimen: Specimen, sections: tuple[str, ...]) -> SensorSuite:
    """Make the paper's sensors: the orientation of every section that moves."""
    sensors = SpecimenSensors(specimen, sections, Registration())
    return SensorSuite(tuple(sensors.orientation(s, NOISE_RAD) for s in sections if s != "base"))

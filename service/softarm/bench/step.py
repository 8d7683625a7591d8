"""``softarm bench step``: what a step of the estimator costs, in parts, as a whole, and as the mesh grows."""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import click
import numpy as np
from scipy.sparse.linalg import splu

from softarm.bench.step_parts import solvers, tracking_parts
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm.estimator.arm import model_on_mesh
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.tracking import BackgroundFactorisation, TrackingModel
from softarm.estimator.fem.tracking.frozen_tangent import freeze_tangent
from softarm.estimator.geometry import DEFAULTS, Resolution, build_mesh
from softarm.estimator.geometry.convert import to_elements
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
from softarm.estimator.mesh import Mesh
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
PLAIN_NOTES = (
    "Median ratio: median over the instants of a step's time over that with all parts. With sensor noise; "
    "the factor of the background is one instant old.",
)
LINEAR = Resolution(layers=6, section_layers=2)
GROWTH = (
    Resolution(layers=1, section_layers=1),
    Resolution(layers=2, section_layers=1),
    Resolution(layers=3, section_layers=2),
    Resolution(layers=3, section_layers=2, through=2),
    Resolution(layers=1, section_layers=1, refinement=2),
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


def switched_off(
    specimen: Specimen, model: FiniteElementModel, suite: SensorSuite, run: TimedRun
) -> list[dict[str, Cell]]:
    """Follow the motion, with noise, with each part of the tracking path switched off."""
    random, settings = np.random.default_rng(1), tracker_settings(specimen, model)
    samples = [
        (
            inputs,
            readings + NOISE_RAD * random.standard_normal(readings.shape),
            inputs.pressures + NOISE_PA * random.standard_normal(inputs.pressures.shape),
        )
        for inputs, readings in zip(run.inputs, run.readings, strict=True)
    ]
    return tracking_parts(model, samples, lambda tracked: Estimator(tracked, suite, settings), RATE_HZ)


def growth(
    meshes: Sequence[Mesh], specimen: Specimen, done: Callable[[float], None]
) -> list[dict[str, Cell]]:
    """Time assembly, factor and solution as the mesh grows, with the exponent of each over the nodes."""
    costs = []
    for mesh in meshes:
        costs.append((float(len(mesh.points)), *_costs(model_on_mesh(specimen, mesh))))
        done(1)
    rows = np.array(sorted(costs))
    slopes = [float(np.polyfit(np.log(rows[:, 0]), np.log(column), 1)[0]) for column in rows[:, 1:].T]
    table = [_growth_row(int(row[0]), row[1:]) for row in rows]
    return [*table, {**_growth_row("exponent", np.array(slopes)), "ratio": None}]


def _costs(model: FiniteElementModel) -> tuple[float, float, float, float]:
    """Time assembly, our factor, its solution and SuperLU's factor at rest [ms]."""
    inputs, state = model.no_inputs(), model.rest()
    tangent = model.balance(state.displacement, inputs).evaluation.tangent
    factor = model.linearise(state, inputs).factor
    assert tangent is not None
    assert factor is not None
    matrix = model.body.pattern.matrix(tangent.values, tangent.mirror)
    forces = model.linearise(state, inputs).input_forces()
    cases: tuple[tuple[Callable[[], Any], int], ...] = (
        (lambda: model.balance(state.displacement, inputs), 8),
        (lambda: model.body.plan.factorise(tangent), 8),
        (lambda: factor.solve(forces), 8),
        (lambda: splu(matrix), 2),
    )
    assemble, ours, solve, superlu = (float(np.median(milliseconds(work, n))) for work, n in cases)
    return assemble, ours, solve, superlu


def _growth_row(nodes: Cell, values: Floats) -> dict[str, Cell]:
    keys = ("assemble_ms", "factor_ms", "solve_ms", "superlu_factor_ms")
    return {"nodes": nodes, **dict(zip(keys, values.tolist(), strict=True)), "ratio": values[3] / values[1]}


@click.command()
@click.option("--specimen", "name", default="sopra", show_default=True, help="Specimen to solve.")
@quick_option
@json_option
@click.option("--plain", is_flag=True, help="Switch off each part of the tracking path in turn, and stop.")
def command(name: str, quick: bool, as_json: bool, plain: bool) -> int:
    """Time a step of the estimator, part by part.

    Processor time of the calling thread, so that another program on the machine disturbs little; the work of
    the background thread is not in it. The motion goes on at 100 Hz; sensors are two orientations and all
    pressures, unknown are four forces, and every scheme but the first iterates to the nonlinear optimum.

    Example: softarm bench step --quick

    Example: softarm bench step --plain
    """
    specimen = load_specimen(name)
    resolution = DEFAULTS[specimen.geometry.kind]
    meshes = {"20-node hexahedra": build_mesh(specimen, resolution)}
    if plain:
        show(_plain_table(specimen, meshes["20-node hexahedra"], 40 if quick else 120), as_json=as_json)
        return 0
    if not quick:
        meshes["linear tetrahedra"] = to_elements(build_mesh(specimen, LINEAR), "tet4")
    larger = [build_mesh(specimen, r) for r in (GROWTH[:2] if quick else GROWTH)]
    tables = []
    with progress("Timing", 8 * len(meshes) + len(larger)) as advance:
        for kind, mesh in meshes.items():
            model = model_on_mesh(specimen, mesh)
            suite = orientations(specimen, model.sections)
            run = motion(model, suite, np.array(specimen.gravity_m_s2), 40 if quick else 200)
            title = f"{specimen.name}, {kind}, {len(mesh.points)} nodes"
            tables.append(Table(f"{title}: parts", parts(model, suite, run)))
            state, _ = model.solve(run.inputs[0], model.rest())
            tables.append(
                Table(
                    f"{title}: solvers",
                    solvers(model, state.displacement, run.inputs[0], REPEATS),
                    SOLVER_NOTES,
                )
            )
            notes = (
                f"Noise: {np.degrees(NOISE_RAD):.1f} degrees and {NOISE_PA:.0f} Pa, white. "
                "force error: root mean square over the four forces.",
            )
            tables.append(Table(f"{title}: steps", steps(specimen, model, suite, run, advance), notes))
        tables.append(Table(f"{specimen.name}: growth with the mesh", growth(larger, specimen, advance)))
    show(*tables, as_json=as_json)
    return 0


def _plain_table(specimen: Specimen, mesh: Mesh, samples: int) -> Table:
    model = model_on_mesh(specimen, mesh)
    suite = orientations(specimen, model.sections)
    run = motion(model, suite, np.array(specimen.gravity_m_s2), samples)
    title = f"{specimen.name}, {len(mesh.points)} nodes: tracking without one of its parts"
    return Table(title, switched_off(specimen, model, suite, run), PLAIN_NOTES)


def orientations(specimen: Specimen, sections: tuple[str, ...]) -> SensorSuite:
    """Make the paper's sensors: the orientation of every section that moves."""
    sensors = SpecimenSensors(specimen, sections, Registration())
    return SensorSuite(tuple(sensors.orientation(s, NOISE_RAD) for s in sections if s != "base"))

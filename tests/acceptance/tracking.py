"""``softarm bench tracking``: what each part of the tracking path buys, and what a growing mesh costs."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import click
import numpy as np
from scipy.sparse.linalg import splu

from softarm.bench.step import (
    NOISE_PA,
    NOISE_RAD,
    RATE_HZ,
    TimedRun,
    milliseconds,
    motion,
    orientations,
    tracker_settings,
)
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm.estimator.arm import model_on_mesh
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.tracking import BackgroundFactorisation, TrackingModel
from softarm.estimator.fem.tracking.model import RotationStrainUpdate
from softarm.estimator.fem.tracking.rotation_strain import SingleRotationStrain
from softarm.estimator.geometry import DEFAULTS, Resolution, build_mesh
from softarm.estimator.inverse import Estimator
from softarm.estimator.mesh import Mesh
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.specimen import Specimen, load_specimen

NOTES = (
    "Median ratio: median over the instants of a step's time over that with all parts. With sensor noise; "
    "the factor of the background is one instant old.",
)
GROWTH = (
    Resolution(layers=1, section_layers=1),
    Resolution(layers=2, section_layers=1),
    Resolution(layers=3, section_layers=2),
    Resolution(layers=3, section_layers=2, through=2),
    Resolution(layers=1, section_layers=1, refinement=2),
)
STARTING = 10
"""Instants at the beginning of a motion that are not counted."""

MakeEstimator = Callable[[Any], Estimator[Any, Any]]
Sample = tuple[Inputs, Floats, Floats]


@dataclass(frozen=True)
class StraightSteps:
    """Carries steps along, but moves straight along them."""

    strain_update: RotationStrainUpdate

    def __getattr__(self, name: str) -> Any:
        return getattr(self.strain_update, name)

    def moved(self, displacement: Floats, deformation: Any, step: Floats, rotations: Any) -> Floats:
        """Move by a linear step, carried along the rotations."""
        del deformation
        divergence = self.strain_update.corotated_divergence(rotations, step)
        return displacement + self.strain_update.solve_poisson(divergence)


class WithoutRotation:
    """Takes the old factor's steps as they are."""

    def deformation(self, displacement: Floats) -> Floats:
        """Return the displacement: no gradient is wanted."""
        return displacement

    def rotations(self, before: Floats, after: Floats) -> None:
        """Return nothing: nothing is rotated."""

    def solve_poisson(self, nodal: Floats) -> Floats:
        """Return the values: no step is put together from gradients."""
        return nodal

    def corotated_divergence(self, rotations: None, nodal: Floats) -> Floats:  # noqa: ARG002
        """Return the step as it is."""
        return nodal

    def pulled_back(self, rotations: None, forces: Floats) -> Floats:  # noqa: ARG002
        """Return the forces as they are."""
        return forces

    def moved(
        self,
        displacement: Floats,
        deformation: Floats,  # noqa: ARG002
        step: Floats,
        rotations: None,  # noqa: ARG002
    ) -> Floats:
        """Move straight along a step."""
        return displacement + step


def tracking_parts(
    model: FiniteElementModel, samples: Sequence[Sample], make: MakeEstimator, rate_hz: float
) -> list[dict[str, Cell]]:
    """Follow a motion with all parts of the tracking path, and with each of them switched off.

    All estimators see the same instant in turn, and each background thread is waited for before the next, so
    that what disturbs the machine disturbs all alike and the ratios repeat.

    Args:
        model: The finite-element model.
        samples: True inputs, noisy readings and noisy pressures at each instant.
        make: Makes the estimator of a model.
        rate_hz: Instants per second.
    """
    fast = SingleRotationStrain.of(model.body)
    cases: dict[str, tuple[RotationStrainUpdate | None, bool, bool]] = {
        "nothing": (fast, True, True),
        "background factorisation": (fast, True, False),
        "carrying the factor along with the material": (WithoutRotation(), True, True),
        "finite rotations of steps": (StraightSteps(fast), True, True),
        "single-precision factor": (fast, False, True),
        "compiled single-precision rotation-strain": (model.body.rotation_strain, True, True),
        "reuse of a factor": (None, True, False),
    }
    spent: dict[str, list[float]] = {name: [] for name in cases}
    iterations: dict[str, list[int]] = {name: [] for name in cases}
    converged = dict.fromkeys(cases, 0)
    with ExitStack() as stack:
        threads, estimators = {}, {}
        for name, (strain_update, single, background) in cases.items():
            thread = None
            if background:
                thread = stack.enter_context(BackgroundFactorisation(model, single=single))
            threads[name] = thread
            tracked = (
                TrackingModel(model, thread, strain_update=strain_update, single=single)
                if strain_update
                else model
            )
            estimators[name] = make(tracked)
        names = list(cases)
        for k, (inputs, readings, pressures) in enumerate(samples):
            for name in names[k % len(names) :] + names[: k % len(names)]:
                begin = time.thread_time()
                estimate = estimators[name].update(k / rate_hz, readings, pressures, inputs.gravity)
                spent[name].append(1e3 * (time.thread_time() - begin))
                iterations[name].append(estimate.iterations)
                converged[name] += estimate.converged
                thread = threads[name]
                if thread is not None:
                    thread.wait()
    return [_row(name, spent, iterations[name], converged[name]) for name in names]


def _row(name: str, spent: dict[str, list[float]], iterations: list[int], converged: int) -> dict[str, Cell]:
    part, whole = np.array(spent[name][STARTING:]), np.array(spent["nothing"][STARTING:])
    p99 = float(np.percentile(part, 99))
    return {
        "without": name,
        "median_ms": float(np.median(part)),
        "p99_ms": p99,
        "median_ratio": float(np.median(part / whole)),
        "p99_ratio": p99 / float(np.percentile(whole, 99)),
        "linearisations": float(np.mean(iterations[STARTING:])),
        "converged_percent": 100.0 * converged / len(iterations),
    }


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
def command(name: str, quick: bool, as_json: bool) -> int:
    """Time the tracking path without each of its parts, and its finite elements as the mesh grows.

    Motion and sensors are those of ``softarm bench step``, with noise.

    Example: softarm bench tracking --quick
    """
    specimen = load_specimen(name)
    mesh = build_mesh(specimen, DEFAULTS[specimen.geometry.kind])
    model = model_on_mesh(specimen, mesh)
    suite = orientations(specimen, model.sections)
    run = motion(model, suite, np.array(specimen.gravity_m_s2), 40 if quick else 120)
    title = f"{specimen.name}, {len(mesh.points)} nodes: tracking without one of its parts"
    larger = [build_mesh(specimen, resolution) for resolution in (GROWTH[:2] if quick else GROWTH)]
    without = Table(title, switched_off(specimen, model, suite, run), NOTES)
    with progress("Meshes", len(larger)) as advance:
        grown = Table(f"{specimen.name}: growth with the mesh", growth(larger, specimen, advance))
    show(without, grown, as_json=as_json)
    return 0

"""``softarm bench rod``: how far the calibrated rod is from its finite-element model, and what it costs."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

import softarm.estimator.rod
from softarm.cli.output import json_option, notify, progress, quick_option, show
from softarm.common.rods import fit_now, fitted_rod
from softarm.common.tables import Cell, Table
from softarm.estimator.arm import build_arm, default_loads
from softarm.estimator.errors import InputError
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.model import ArmModel, Inputs
from softarm.estimator.response import BatchInputs
from softarm.estimator.rod import FittedRod, HeldOut, Recipe, adapted, check_rod, sampled_model, shape_key
from softarm.estimator.rod.archive import to_bytes
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.rod.stations import cut
from softarm.estimator.specimen import SHIPPED, Specimen, load_specimen

SCALED = 1.4
"""Factor on the soft segments' stiffness of the second check: what calibration typically finds."""
FORCE_LIMIT = 0.005
COST_LIMIT_MS = 0.3
BATCH = 1000


@click.command()
@click.option(
    "--specimen",
    "names",
    multiple=True,
    default=SHIPPED,
    help=f"Specimen file or name; all shipped ones, {', '.join(SHIPPED)}, when left out.",
)
@click.option("--write", is_flag=True, help="Fit anew and write the rods that come with the package.")
@quick_option
@json_option
def command(names: tuple[str, ...], write: bool, quick: bool, as_json: bool) -> int:
    """Check the calibrated rod against the finite-element model, and time both.

    The tables show the errors of the sections' frames, and of the lateral force that the rod finds from their
    orientations, along rays of pressures, forces and gravity that the fit left out; then with forces at
    heights at which no load acted in the fit; then with the soft segments' stiffness scaled. The exit status
    is 1 if the force at trained places is off by more than 0.5 % of its range, or an evaluation takes over
    0.3 ms.

    Example: softarm bench rod --specimen sopra
    """
    errors: list[dict[str, Cell]] = []
    costs: list[dict[str, Cell]] = []
    for name in names:
        specimen = load_specimen(name)
        with progress(f"{specimen.name}: rod") as advance:
            fitted = _rod(specimen, write, advance)
        if write:
            notify(f"wrote {_ship(specimen, name, fitted)}")
        with progress(f"{specimen.name}: check") as advance:
            errors += error_rows(specimen, fitted, quick, advance)
        costs += cost_rows(specimen, fitted)
    notes = (
        "Angles and places of all sections that move, in every state found along the rays; forces from exact "
        "orientations and pressures, over the largest force of the set; range: the forces on each place.",
        f"stiffness x {SCALED:g}: soft segments scaled; rigid sections and winding are as they were.",
    )
    cost_note = "One thread. A rod's evaluation ends in equilibrium, with all derivatives by the inputs."
    show(
        Table("Calibrated rod against finite elements, held out", errors, notes),
        Table("Cost of one evaluation", costs, (cost_note,)),
        as_json=as_json,
    )
    return 0 if _passes(errors, costs) else 1


def _passes(errors: list[dict[str, Cell]], costs: list[dict[str, Cell]]) -> bool:
    forces = [float(row["force_rms_percent"] or 0.0) for row in errors if row["loads"] == "on sections"]
    medians = [float(row["median_ms"] or 0.0) for row in costs if row["model"] == "rod"]
    return max(forces) <= 100.0 * FORCE_LIMIT and max(medians) <= COST_LIMIT_MS


def _rod(specimen: Specimen, anew: bool, advance: Callable[[float], None]) -> FittedRod:
    def tell(_: int, __: int) -> None:
        advance(1)

    return fit_now(specimen, tell) if anew else fitted_rod(specimen, tell)


def _ship(specimen: Specimen, name: str, fitted: FittedRod) -> Path:
    """Write a rod beside the package's others.

    Raises:
        InputError: The specimen is none of the shipped ones.
    """
    if name not in SHIPPED:
        raise InputError("--write", f"{name!r} is no shipped specimen", f"name {', '.join(SHIPPED)}")
    path = Path(softarm.estimator.rod.__file__).parent / "shipped" / f"{name}.npz"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(to_bytes(fitted, shape_key(specimen), specimen.name))
    return path


def error_rows(
    specimen: Specimen, fitted: FittedRod, quick: bool, advance: Callable[[float], None]
) -> list[dict[str, Cell]]:
    """Return a rod's errors as measured when it was fitted; the full form adds those of a stiffer arm."""
    rows = _rows(specimen.name, "as described", fitted.report.trained, fitted.report.untrained)
    if quick:
        return rows
    model = sampled_model(specimen)
    scales = {segment.name: SCALED for segment in specimen.segments}
    scaled = model.with_scales(dict.fromkeys(model.parameters, 1.0) | scales)
    stations, check = cut(specimen, scaled), Recipe().check
    rod = fitted.rod.with_scales(scales)
    report = check_rod(rod, specimen, scaled, stations, check, lambda *_: advance(1))
    return rows + _rows(specimen.name, f"stiffness x {SCALED:g}", report.trained, report.untrained)


def _rows(name: str, title: str, trained: HeldOut, untrained: HeldOut) -> list[dict[str, Cell]]:
    return [
        {
            "specimen": name,
            "stiffness": title,
            "loads": place,
            "states": part.states,
            "not_found": part.lost,
            "angle_rms_degrees": float(np.degrees(part.angle_rms)),
            "angle_max_degrees": float(np.degrees(part.angle_max)),
            "place_rms_mm": 1e3 * part.position_rms,
            "place_max_mm": 1e3 * part.position_max,
            "force_rms_percent": 100.0 * part.force_rms,
            "force_max_percent": 100.0 * part.force_max,
            "range_n": ", ".join(f"{top:.2g}" for top in part.force_range),
        }
        for place, part in (("on sections", trained), ("between sections", untrained))
    ]


def cost_rows(specimen: Specimen, fitted: FittedRod) -> list[dict[str, Cell]]:
    """Time an evaluation with all derivatives along a smooth motion."""
    rod = adapted(fitted.rod, specimen)
    model = build_arm(specimen, default_loads(specimen))
    limits = np.array(specimen.pressure_limits)
    rod_ms, fem_ms = _timed(rod, _motion(rod, limits, 2000)), _timed(model, _motion(model, limits, 60))
    drive = _motion(rod, limits, BATCH)
    names = ("pressures", "loads", "gravity")
    inputs = BatchInputs(*(np.array([getattr(i, name) for i in drive]) for name in names))
    rod.evaluate(inputs)
    begin = time.perf_counter()
    rod.evaluate(inputs)
    batch_ms = 1e3 * (time.perf_counter() - begin) / BATCH
    rows: list[dict[str, Cell]] = []
    for name, times in (("rod", rod_ms), ("rod, batch", np.array([batch_ms])), ("finite elements", fem_ms)):
        median = float(np.median(times))
        rows.append(
            {
                "specimen": specimen.name,
                "model": name,
                "jacobian": f"{6 * len(model.sections)} x {model.chambers + len(model.loads)}",
                "median_ms": median,
                "p99_ms": float(np.quantile(times, 0.99)) if len(times) > 1 else None,
                "finite_elements_over_this": float(np.median(fem_ms)) / median,
            }
        )
    return rows


def _motion(model: CalibratedRod | FiniteElementModel, limits: Any, steps: int) -> list[Inputs]:
    """Drive chambers and loads along a smooth path, the same whatever the number of steps."""
    phase = np.linspace(0.0, 2.0 * np.pi * steps / 2000.0, steps)[:, None]
    pressures = limits * 0.4 * (1.0 - np.cos(phase * (1.0 + np.arange(len(limits)) % 3)))
    loads = 0.05 * np.sin(phase * (1.0 + np.arange(len(model.loads))))
    gravity = np.array([0.0, 0.0, 9.81])
    return [Inputs(p, load, gravity) for p, load in zip(pressures, loads, strict=True)]


def _timed(model: ArmModel[Any, Any], drive: list[Inputs]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Time solving and differentiating at each of some inputs [ms], the first ones left out."""
    state, eye, times = model.rest(), np.eye(6 * len(model.sections)), []
    explicit = isinstance(model, CalibratedRod)
    for inputs in drive:
        begin = time.perf_counter()
        if not explicit:
            state, _ = model.solve(inputs, state)
        step = model.linearise(state, inputs)
        step.response(eye)
        times.append(1e3 * (time.perf_counter() - begin))
        state = step.strain if explicit else state
    return np.array(times[len(times) // 10 :])

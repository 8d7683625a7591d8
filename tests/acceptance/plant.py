"""``softarm bench plant``: how much faster than real time the fake arm runs on one core."""

import time
from collections.abc import Callable

import click
import numpy as np

from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.effects import Concealed
from softarm.fakes.plant.state import Cord, PlantInputs

SAMPLE = 0.01


def vented(moment: float) -> PlantInputs:  # noqa: ARG001
    """Leave the arm alone."""
    return PlantInputs(np.zeros(6))


def moving(moment: float) -> PlantInputs:
    """Swing all chambers."""
    phases = np.arange(6) * 2.0 * np.pi / 3.0
    return PlantInputs(2.5e4 * (1.0 + np.sin(2.0 * moment + phases)))


def pulled(moment: float) -> PlantInputs:
    """Swing all chambers against the gauge's cord."""
    return PlantInputs(moving(moment).valve_pressures, Cord("tip", (0.2, 0.0, 0.33), 0.15))


CASES: dict[str, tuple[Callable[[float], PlantInputs], tuple[Concealed, ...]]] = {
    "at rest": (vented, ()),
    "all chambers": (moving, ()),
    "all chambers, taut cord": (pulled, ()),
    "all chambers, cord, obstacle, creep, hysteresis": (
        pulled,
        (Concealed("contact_obstacle"), Concealed("viscoelastic_creep"), Concealed("hysteresis")),
    ),
}


def real_time_factor(case: str, seconds: float) -> float:
    """Run one case for a stretch of the arm's time and compare with the processor's, one core."""
    drive, effects = CASES[case]
    arm = FakeArm(effects=effects)
    arm.advance(0.1, drive(0.0))
    begin = time.process_time()
    for number in range(1, int(seconds / SAMPLE)):
        arm.advance(0.1 + number * SAMPLE, drive(number * SAMPLE))
    return seconds / (time.process_time() - begin)


@click.command()
@json_option
@quick_option
def command(as_json: bool, quick: bool) -> None:
    """Time the fake arm on one core.

    Example: softarm bench plant --quick
    """
    step = 1e3 * FakeArm().parameters.step
    rows: list[dict[str, Cell]] = []
    with progress("running the fake arm", len(CASES)) as advance:
        for case in CASES:
            factor = real_time_factor(case, 4.0 if quick else 30.0)
            rows.append({"case": case, "step_ms": step, "real_time_factor": factor})
            advance(1)
    show(
        Table(
            "Fake arm", rows, ("Real-time factor: seconds of motion per second of processor time, aim 5.",)
        ),
        as_json=as_json,
    )

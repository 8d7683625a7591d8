"""Times the fake arm: ``python -m softarm.fakes.plant.speed [SECONDS]`` prints one JSON row per case."""

import json
import sys
import time
from collections.abc import Callable

import numpy as np

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


def main(seconds: float) -> None:
    """Print the real-time factor of every case."""
    step = FakeArm().parameters.step
    for case in CASES:
        row = {"case": case, "step_ms": 1e3 * step, "real_time_factor": real_time_factor(case, seconds)}
        sys.stdout.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)

"""Driving a fake arm in tests."""

from collections.abc import Callable

import numpy as np

from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.state import PlantInputs, PlantState

MakeArm = Callable[..., FakeArm]


def pressures(**chambers: float) -> PlantInputs:
    """Pressures by chamber, such as c0=3e4."""
    values = np.zeros(6)
    for name, value in chambers.items():
        values[int(name[1:])] = value
    return PlantInputs(values)


def hold(arm: FakeArm, inputs: PlantInputs, seconds: float) -> PlantState:
    """Hold the inputs for a while after the last step."""
    arm.advance(arm.state.time + seconds, inputs)
    return arm.state


def move(arm: FakeArm, inputs: PlantInputs, seconds: float) -> PlantState:
    """Ramp to the inputs over two periods of the swing, which then hardly rings, and hold them."""
    start, target = arm.state.chamber_pressures, inputs.valve_pressures
    for share in np.linspace(0.0, 1.0, 28)[1:]:
        hold(arm, PlantInputs(start + share * (target - start), inputs.cord, inputs.hand), 0.04)
    return hold(arm, inputs, seconds)

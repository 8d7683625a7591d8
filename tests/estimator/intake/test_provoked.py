"""What pressures provoke is no touch, whatever the law; what moves while they rest is one."""

import numpy as np
import pytest

from softarm.estimator.intake.grid import Grid
from softarm.estimator.intake.provoked import unexplained_motion

STEP = 0.1


def recorded(values):
    """Held pressures of one chamber, below and above their middle alike, and the reading of one sensor."""
    pressures = np.repeat([0.0, 20e3, 40e3, 20e3, 0.0], 80)[:, None]
    read = values(STEP * np.arange(len(pressures)), pressures[:, 0] / 40e3)
    index = np.zeros(1, dtype=np.int64)
    return Grid(STEP * np.arange(len(pressures)), STEP, pressures, read[:, None], index, ("rad",))


def swing(time, since):
    """A swing of 2 Hz that dies away within a second after ``since``."""
    late = np.maximum(time - since, 0.0)
    return np.where(time >= since, np.exp(-late / 0.4) * np.sin(4.0 * np.pi * late), 0.0)


@pytest.mark.parametrize("power", [1, 2])
def test_swings_after_steps_are_provoked_whatever_the_law(power):
    def reading(time, pressure):
        # Even about the middle of the pressures, a law has no slope that a regression could see.
        law = (2.0 * pressure - 1.0) ** power
        return 0.1 * law + sum(0.1 * swing(time, at) for at in range(8, 40, 8))

    assert unexplained_motion(recorded(reading)).excess.max() == 0.0


def test_motion_while_the_pressures_rest_is_not():
    found = unexplained_motion(
        recorded(lambda time, pressure: 0.1 * pressure + 0.3 * (abs(time - 21.0) < 1.0))
    )
    begun = found.time[found.excess[:, 0] > 0.1]
    assert {round(t) for t in begun} == {20, 22}

"""What becomes of the readings of a sensor that has an offset of its own."""

import numpy as np
import pytest

from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect, signals_of
from softarm.estimator.sensing import Bend
from softarm.estimator.simulation import Drive
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import world

BIAS = np.array([0.05, -0.02])
TILT = np.stack([np.linspace(-0.3, 0.4, 50), np.linspace(0.2, -0.1, 50)], axis=-1)


def misread(effect: str, *theta: float) -> np.ndarray:
    """Return what a bend sensor with an offset reads of a tilt."""
    seen = world(("bend_tip",))
    placed = PlacedEffect(EFFECTS[effect], Spot(seen, Place(sensor="bend_tip")), np.array(theta))
    drive = Drive.of(np.linspace(0.0, 5.0, len(TILT)), np.zeros((len(TILT), 6)), np.zeros(3), 2, 2)
    sensor = Bend("bend_tip", 1, 0.01, bias=BIAS)
    readings, _ = placed.misread(signals_of(drive, seen), sensor, TILT + BIAS)
    return readings


def test_the_offset_of_a_bend_sensor_does_not_turn_with_its_mount():
    quarter = misread("frame_misalignment", np.pi / 2.0)
    assert quarter == pytest.approx(np.stack([-TILT[:, 1], TILT[:, 0]], axis=-1) + BIAS)


def test_the_offset_of_a_bend_sensor_does_not_grow_with_its_scale():
    assert misread("sensor_scale", 0.5) == pytest.approx(1.5 * TILT + BIAS)


def test_a_new_offset_is_added_to_the_own_one():
    assert misread("sensor_bias", 0.01, 0.03) == pytest.approx(TILT + BIAS + [0.01, 0.03])

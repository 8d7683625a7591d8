"""Effects that change how stiff a segment is, and so how it vibrates."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect, signals_of
from softarm.estimator.simulation import Drive
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import world

CLOCK = np.linspace(0.0, 900.0, 30)


@pytest.mark.parametrize(
    ("name", "place", "theta"),
    [
        ("segment_stiffness", Place(segment="lower"), [0.3]),
        ("thermal_drift", Place(segment="lower"), [-0.2, 300.0]),
        ("thermal_drift", Place(), [0.4, 500.0]),
    ],
)
def test_the_stiffness_that_vibrates_is_that_which_bears_the_load(name, place, theta):
    """Strain times stiffness, the stress, stays what it was."""
    own = world(())
    placed = PlacedEffect(EFFECTS[name], Spot(own, place), np.array(theta))
    strains = np.random.default_rng(2).normal(size=(len(CLOCK), len(own.segments), 4))
    drive = Drive.of(CLOCK, np.zeros((len(CLOCK), 6)), np.zeros((len(CLOCK), 3)), len(own.sections), 2)
    signals = replace(signals_of(drive, own), strains=strains)
    changed, _ = placed.act(signals, ())
    stiffness = placed.stiffness(CLOCK)
    chosen = placed.spot.segments > 0.0
    stress = stiffness[:, None, None] * changed[:, chosen]
    np.testing.assert_allclose(stress, strains[:, chosen], atol=1e-12)
    np.testing.assert_array_equal(changed[:, ~chosen], strains[:, ~chosen])


def test_what_moves_no_stiffness_vibrates_as_before():
    placed = PlacedEffect(EFFECTS["chamber_gain"], Spot(world(()), Place(chamber=0)), np.array([0.1]))
    assert placed.stiffness(CLOCK) is None

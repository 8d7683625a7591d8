"""What effects change in a session, where the recorded base tells where the laboratory is."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.stage import Stage, superposes
from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.rotations import exp
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import SECTIONS, model, session

TILT = 0.01, -0.02


def stage(registration: Registration) -> Stage:
    """A straight arm without weight or pressure, seen by orientations in the laboratory."""
    make = SpecimenSensors(load_specimen("sopra"), SECTIONS, registration)
    suite = SensorSuite(tuple(make.orientation(section) for section in SECTIONS))
    known = session("nominal", 0, nominal=True)
    still = replace(
        known,
        pressures=np.zeros_like(known.pressures),
        suite=suite,
        readings=np.tile([1.0, 0.0, 0.0, 0.0], (known.samples, len(SECTIONS))),
        sigma=np.full(suite.size, 1e-3),
    )
    return calibrate_sessions(model(), [known]).stage(model(), still)


def tilted(own: Stage, beneath: float) -> np.ndarray:
    """What a tilt of the base changes in the orientations, shape (sections, 3)."""
    placed = PlacedEffect(EFFECTS["base_tilt"], Spot(own.world, Place()), np.array([*TILT, beneath]))
    return own.change([placed])[0].reshape(len(SECTIONS), 3)


@pytest.mark.parametrize("beneath", [0.0, 1.0])
def test_without_a_recorded_base_all_of_a_tilt_shows(beneath: float) -> None:
    assert np.allclose(tilted(stage(Registration()), beneath), [*TILT, 0.0], atol=1e-6)


def test_a_recorded_base_hides_the_tilt_that_it_follows() -> None:
    own = stage(Registration(exp(np.array([np.pi, 0.0, 0.0]))))
    assert np.allclose(tilted(own, 0.0), 0.0, atol=1e-9)
    assert np.allclose(tilted(own, 1.0), [*TILT, 0.0], atol=1e-6)


def test_effects_that_superpose_change_together_what_each_changes_alone() -> None:
    own = stage(Registration())
    theta = {"chamber_gain": [0.2], "pressure_bias": [3e3], "material_softening": [0.3, 2.0]}
    places = {"material_softening": [Place(segment=name) for name in own.world.segments]}
    for name, values in theta.items():
        chambers = [Place(chamber=k) for k in range(6)]
        placed = [
            PlacedEffect(EFFECTS[name], Spot(own.world, place), np.array(values))
            for place in places.get(name, chambers)
        ]
        assert all(superposes(one) for one in placed)
        alone = np.stack([own.first_order(one) for one in placed], axis=-1)
        np.testing.assert_allclose(own.first_order_of_many(placed), alone, atol=1e-12)


def test_what_moves_the_base_or_changes_how_the_arm_vibrates_does_not_superpose() -> None:
    own = stage(Registration())
    tip, tilt, stiff = EFFECTS["tip_payload"], EFFECTS["base_tilt"], EFFECTS["segment_stiffness"]
    assert not superposes(PlacedEffect(stiff, Spot(own.world, Place(segment="lower")), np.array([0.2])))
    assert not superposes(PlacedEffect(tip, Spot(own.world, Place(section="tip")), np.array([0.02])))
    assert not superposes(PlacedEffect(tilt, Spot(own.world, Place()), np.array([*TILT, 0.0])))

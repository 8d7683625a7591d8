import pickle

import numpy as np
import pytest

from softarm.estimator.effects import EFFECTS
from softarm.estimator.simulation import Drive
from tests.estimator.effects.effects_bench import WORLD, drive_of, placed, run


def lively(samples: int = 60) -> Drive:
    time = 0.1 * np.arange(samples)
    phase = np.array([0.3, 0.5, 0.7, 0.9, 1.1, 1.3])
    return drive_of(time, 5e4 * np.sin(time[:, None] * phase) ** 2)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_of_no_strength_changes_nothing(name: str):
    drive = lively()
    plain = run(drive)
    for place in EFFECTS[name].places(WORLD):
        where = place.model_dump(exclude_none=True)
        after = run(drive, placed(name, EFFECTS[name].neutral, **where))
        assert after.settled
        assert np.allclose(after.response.frames.rotations, plain.response.frames.rotations, atol=1e-12)
        for sensor, reading in plain.readings.items():
            assert np.allclose(after.readings[sensor], reading, atol=1e-12)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_reaches_the_workers_of_a_diagnosis(name: str):
    assert pickle.loads(pickle.dumps(EFFECTS[name])).parameters == EFFECTS[name].parameters


def test_a_direction_is_from_minus_to_plus_half_a_turn_however_far_a_fit_went():
    depth, azimuth, _ = EFFECTS["local_stiffness_defect"].parameters
    assert azimuth.value(azimuth.scaled(np.radians(-180.3))) == pytest.approx(np.radians(179.7))
    assert azimuth.value(azimuth.scaled(1.2)) == pytest.approx(1.2)
    assert depth.value(depth.scaled(-1.9)) == pytest.approx(-1.9)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_typical_effect_shows(name: str):
    effect = EFFECTS[name]
    drive = lively()
    plain = run(drive)
    where = effect.places(WORLD)[0].model_dump(exclude_none=True)
    after = run(drive, placed(name, effect.typical, **where))
    assert after.settled
    changes = [np.abs(after.readings[s] - r).max() for s, r in plain.readings.items()]
    twist = np.abs(after.response.strains - plain.response.strains).max()
    assert max([*changes, twist]) > 1e-5


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_run_cut_in_two_gives_the_same(name: str):
    effect = EFFECTS[name]
    drive = lively()
    where = effect.places(WORLD)[0].model_dump(exclude_none=True)
    one = placed(name, effect.typical, **where)
    whole = run(drive, one)

    first = run(drive.at(np.arange(25)), one)
    second = run(drive.at(np.arange(25, drive.samples)), one, memories=first.memories)
    for sensor, reading in whole.readings.items():
        joined = np.concatenate([first.readings[sensor], second.readings[sensor]])
        assert np.allclose(joined, reading, atol=1e-6)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_describes_itself(name: str):
    effect = EFFECTS[name]
    assert effect.name == name
    assert 1 <= len(effect.parameters) <= 4
    for parameter in effect.parameters:
        assert parameter.lower <= parameter.typical <= parameter.upper
        assert parameter.transform == "linear" or parameter.lower > 0.0
    told = effect.sentence(effect.typical, effect.places(WORLD)[0])
    assert "{" not in told
    assert told.endswith(".")
    assert effect.source

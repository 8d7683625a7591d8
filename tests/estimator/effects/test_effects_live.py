"""Effects step by step in time, and on an arm that is not linear."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.simulate import advance_with, simulate_with
from softarm.estimator.simulation import Drive
from tests.estimator.effects.effects_bench import WORLD, placed, run, step_drive
from tests.estimator.simulation.straight_arm import straight_arm
from tests.estimator.simulation.test_simulation_arm import some_drive, toy


def instant(drive: Drive, k: int) -> Drive:
    return drive.at(np.array([k]))


def test_stepping_in_time_follows_the_whole_run():
    drive = step_drive(dt=0.05)
    effects = [placed("viscoelastic_creep", [0.3, 2.0, 0.0]), placed("line_lag", [0.2])]
    whole = run(drive, *effects)
    arm, memories = straight_arm(drive.time[:1]), None
    response, couples, strains = arm.respond(instant(drive, 0)), np.zeros((1, 2, 4)), []
    for k in range(drive.samples):
        now = replace(instant(drive, k), couples=couples)
        shaped, memories = advance_with(effects, WORLD, now, response, memories)
        response, couples = arm.respond(shaped), shaped.couples
        strains.append(response.strains[0])
    late = np.abs(np.array(strains) - whole.response.strains)
    assert late[-1].max() < 1e-3
    assert late.max() < 0.05 * np.abs(whole.response.strains).max()


def test_the_classes_of_equivalence_have_several_members():
    classes = [name for effect in EFFECTS.values() for name in effect.equivalence]
    assert {name for name in classes if classes.count(name) < 2} == set()


@pytest.mark.parametrize(
    ("name", "theta", "where"),
    [
        ("segment_stiffness", [0.2], {"segment": "upper"}),
        ("tip_payload", [0.01], {"section": "tip"}),
        ("contact_obstacle", [40.0, 0.01, 0.0], {"section": "tip"}),
        ("base_compliance", [0.3, 0.01], {}),
    ],
)
def test_effects_balance_on_an_arm_that_is_not_linear(name: str, theta: list[float], where: dict):
    arm, drive = toy(), some_drive()
    effect = placed(name, theta, **where)
    done = simulate_with([effect], arm, WORLD, drive)
    assert done.settled
    again = arm.respond(done.drive, done.response)
    assert np.allclose(again.frames.positions, done.response.frames.positions, atol=1e-5)
    plain = arm.respond(drive)
    assert np.abs(done.response.frames.positions - plain.frames.positions).max() > 1e-4

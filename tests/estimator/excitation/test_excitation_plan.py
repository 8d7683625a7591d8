"""Separations are those of least squares, and plans take what decides."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from softarm.estimator.excitation import (
    EffectPair,
    ManoeuvreLimits,
    SeparatedArm,
    full_plan,
    plan_for,
    standard_manoeuvres,
)
from softarm.estimator.excitation.plan import DECISIVE_SEPARATION
from softarm.estimator.response import ArmResponse
from softarm.estimator.simulation import Drive, Segments
from tests.estimator.effects.effects_bench import SUITE, WORLD, placed
from tests.estimator.simulation.straight_arm import SEGMENTS, straight_arm

LIMITS = ManoeuvreLimits(np.full(6, 8e3), share=1.0)  # the straight arm is linear for small bends only
MANOEUVRES = {m.name: m for m in standard_manoeuvres((0, 0, 0, 1, 1, 1), LIMITS)}


@dataclass(frozen=True)
class StraightArm:
    """The linear arm at any instants."""

    segments: Segments = SEGMENTS

    def respond(
        self, drive: Drive, near: ArmResponse | None = None, *, jacobians: bool = True
    ) -> ArmResponse:
        return straight_arm(drive.time).respond(drive, near)


SUBJECT = SeparatedArm(StraightArm(), SEGMENTS, WORLD, SUITE, np.array([0.0, 0.0, 9.81]))
WEIGHT = placed("tip_payload", [0.02], section="tip")
SPREAD = placed("distributed_mass", [0.15])
CREEP = placed("viscoelastic_creep", [0.2, 8.0, 0.0])
LAG = placed("line_lag", [0.3])
DAMPED = placed("inertia_damping", [0.0, 0.3])


def test_nothing_separates_an_effect_from_itself():
    trial = SUBJECT.trial(MANOEUVRES["steps"])
    assert trial.separation(CREEP, CREEP) < 1e-6
    assert trial.separation(LAG, LAG) < 1e-6


def test_a_rival_of_another_size_is_fitted_to_the_effect():
    trial = SUBJECT.trial(MANOEUVRES["holds"])
    other = placed("viscoelastic_creep", [0.1, 12.0, 0.0])
    assert trial.separation(CREEP, other) < 0.02 * float(np.sum(trial.readings(CREEP) ** 2))


def test_the_separation_is_no_more_than_the_effect_itself():
    trial = SUBJECT.trial(MANOEUVRES["ramps"])
    assert 0.0 <= trial.separation(CREEP, LAG) <= float(np.sum(trial.readings(CREEP) ** 2)) + 1e-9


@pytest.mark.parametrize("rival", [LAG, placed("contact_obstacle", [30.0, 0.005, 0.5], section="tip")])
def test_a_rival_of_no_size_is_a_rival_too(rival):
    """What separates an effect from any rival is no more than what calibration leaves of the effect."""
    trial = SUBJECT.trial(MANOEUVRES["steps"])
    absent = replace(rival, theta=rival.effect.neutral)
    assert trial.separation(CREEP, rival) <= 1.001 * trial.separation(CREEP, absent)


def test_weights_part_when_the_mount_is_turned():
    pair = EffectPair(WEIGHT, SPREAD)
    plan = plan_for([pair], [MANOEUVRES["ramps"], MANOEUVRES["mount_turned_x"]], SUBJECT)
    assert plan.choices[0].manoeuvre.name == "mount_turned_x"


def test_motion_without_pressure_parts_damping_from_a_slow_line_best():
    plan = plan_for(
        [EffectPair(DAMPED, LAG)], [MANOEUVRES["holds"], MANOEUVRES["poses"], MANOEUVRES["pluck"]], SUBJECT
    )
    assert plan.choices[0].manoeuvre.name == "pluck"
    trial = SUBJECT.trial(MANOEUVRES["holds"])
    share = trial.separation(DAMPED, LAG) / float(np.sum(trial.readings(DAMPED) ** 2))
    assert share < 0.05


def test_what_nothing_splits_is_said_to_stay_undecided():
    pair = EffectPair(placed("chamber_gain", [0.02], chamber=0), placed("chamber_gain", [0.02], chamber=0))
    plan = plan_for([pair], list(MANOEUVRES.values())[:4], SUBJECT)
    assert plan.undecided == (pair,)
    assert not plan.choices


def test_a_plan_stops_where_everything_is_decided():
    pairs = [EffectPair(CREEP, LAG)]
    plan = plan_for(pairs, [m for m in MANOEUVRES.values() if not m.by_hand], SUBJECT)
    assert plan.separation(0) >= DECISIVE_SEPARATION
    before = sum(choice.separations[0] for choice in plan.choices[:-1])
    assert before < DECISIVE_SEPARATION
    assert plan.seconds < full_plan(list(MANOEUVRES.values())).seconds


def test_gains_fall_as_less_is_lacking():
    plan = plan_for([EffectPair(CREEP, LAG)], [MANOEUVRES["steps"]], SUBJECT)
    choice = plan.choices[0]
    (found,) = choice.separations
    assert choice.gain([0.5 * found]) == pytest.approx(0.5 * found / choice.seconds)
    assert choice.gain([2.0 * found]) == pytest.approx(found / choice.seconds)
    assert choice.gain([0.0]) == 0.0

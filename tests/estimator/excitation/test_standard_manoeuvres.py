"""Every manoeuvre keeps to the limits, ends vented, and excites what it says."""

from typing import get_args

import numpy as np
import pytest

from softarm.estimator.effects.effect import Excitation
from softarm.estimator.effects.excitation import inventory
from softarm.estimator.excitation import Manoeuvre, ManoeuvreLimits, standard_manoeuvres

SEGMENTS = (0, 0, 0, 1, 1, 1)
LIMITS = ManoeuvreLimits(np.full(6, 65e3), slew=100e3)
MANOEUVRES = standard_manoeuvres(SEGMENTS, LIMITS)
TURNED = {"motion", "mount_turned", "each_chamber", "large_pressures"}
PROMISED: dict[str, set[Excitation]] = {
    "rest": {"rest"},
    "growing_cycles": {"motion", "growing_cycles", "two_amplitudes", "large_pressures"},
    "each_alone": {"motion", "each_chamber", "two_rates", "pressure_steps", "large_pressures"},
    "ramps": {"motion", "two_rates", "large_pressures"},
    "triangles": {"motion", "two_rates", "two_amplitudes", "large_pressures"},
    "holds": {"motion", "holds", "pressure_steps", "large_pressures", "rest"},
    "steps": {"motion", "pressure_steps", "two_amplitudes", "large_pressures"},
    "staircase": {"motion", "small_pressures"},
    "co_contraction": {"motion", "large_pressures"},
    "poses": {"motion", "large_pressures", "pressure_steps"},
    "mount_turned_x": TURNED,
    "mount_turned_y": TURNED,
    "pluck": {"motion"},
}


def within(manoeuvre: Manoeuvre, limits: ManoeuvreLimits) -> bool:
    change = np.abs(np.diff(manoeuvre.pressures, axis=0)) / np.diff(manoeuvre.times)[:, None]
    inside = (manoeuvre.pressures >= 0.0) & (manoeuvre.pressures <= limits.pressures)
    return bool(inside.all() and (change <= limits.slew * (1.0 + 1e-9)).all())


@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_manoeuvres_keep_to_the_limits_and_end_vented(manoeuvre: Manoeuvre):
    assert within(manoeuvre, LIMITS)
    assert np.all(np.diff(manoeuvre.times) > 0.0)
    assert not manoeuvre.pressures[[0, -1]].any()
    assert manoeuvre.pressures.max() <= LIMITS.share * 65e3 + 1e-6


def test_a_slower_slew_makes_no_manoeuvre_faster():
    slow = {m.name: m for m in standard_manoeuvres(SEGMENTS, ManoeuvreLimits(np.full(6, 65e3), slew=20e3))}
    assert all(within(m, ManoeuvreLimits(np.full(6, 65e3), slew=20e3)) for m in slow.values())
    assert all(slow[m.name].duration >= m.duration - 1e-9 for m in MANOEUVRES)
    assert slow["steps"].duration > 1.3 * next(m for m in MANOEUVRES if m.name == "steps").duration


@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_recordings_show_what_the_manoeuvre_promises(manoeuvre: Manoeuvre):
    time = np.arange(0.0, manoeuvre.duration, 0.05)
    gravity = np.tile([0.0, 0.0, 9.81], (len(time), 1))
    found = inventory(time, manoeuvre.at(time), gravity, LIMITS.pressures)
    if manoeuvre.name == "pluck":  # its motion comes from a hand, which pressures do not show
        return
    assert PROMISED[manoeuvre.name] - {"mount_turned"} <= found


def test_all_manoeuvres_excite_everything_but_a_long_run():
    assert set().union(*(PROMISED[m.name] for m in MANOEUVRES)) >= set(get_args(Excitation)) - {"long_run"}


def test_an_arm_without_chambers_is_turned_and_plucked():
    bare = standard_manoeuvres((), ManoeuvreLimits(np.zeros(0)))
    assert {m.name for m in bare} == {"rest", "mount_turned_x", "mount_turned_y", "pluck"}
    assert all(m.pressures.shape[1] == 0 and m.duration > 0.0 for m in bare)

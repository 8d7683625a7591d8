from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.admit import Admitted
from softarm.estimator.diagnosis.result import Quantity
from softarm.estimator.diagnosis.valve_stage import splits_of, valve_findings
from softarm.estimator.diagnosis.valve_verdict import LEFT_OVER, not_compared, valve_diagnosis, wrong_sensors
from softarm.estimator.diagnosis.valves import Ceiling, Gain, ValveLaw, ceilings_of, static, valves_of
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.simulation.filters import first_order
from softarm.estimator.specimen.physics import Place

TIME = np.arange(0.0, 80.0, 0.01)


def settled(setpoint: np.ndarray, bias: float, gain: float, deadband: float, ceiling: float) -> np.ndarray:
    return static(setpoint, ValveLaw(bias=bias, gain=Gain(gain), deadband=deadband, ceiling=Ceiling(ceiling)))


def _recording(name: str, dead_time: float = 0.0, lag: float = 0.0, law: tuple = (0.0, 0.0, 0.0, np.inf)):
    levels = np.array(
        [0.0, 1e3, 2e3, 4e3, 0.0, 20e3, 0.0, 30e3, 40e3, 10e3, 55e3, 50e3, 60e3, 25e3, 5e3, 0.0]
    )
    asked = np.repeat(levels, len(TIME) // len(levels))
    late = np.interp(TIME - dead_time, TIME, asked)
    given = first_order(TIME, settled(late, *law), lag, ())[0]
    given = given + np.random.default_rng(1).normal(0.0, 30.0, len(TIME))
    return Recording(name, TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})


def test_a_perfect_valve_has_no_finding() -> None:
    assert valve_findings(splits_of([_recording("plain")]), []) == ()


def test_dead_time_lag_and_bias_are_found() -> None:
    (valve,) = valves_of(_recording("late", 0.05, 0.06, (-700.0, 0.0, 0.0, np.inf)), {})
    assert valve.timing.dead_time == pytest.approx(0.05, abs=0.015)
    assert valve.timing.lag == pytest.approx(0.06, abs=0.02)
    assert valve.law.bias == pytest.approx(-700.0, abs=60.0)
    assert valve.law.ceiling.pressure == np.inf


@pytest.mark.parametrize("lag", [0.008, 0.053, 0.115, 0.26])
def test_a_delay_is_found_to_a_fraction_of_itself(lag: float) -> None:
    (valve,) = valves_of(_recording("slow", lag=lag), {})
    assert valve.timing.dead_time + valve.timing.lag == pytest.approx(lag, rel=0.02, abs=0.002)


def _late(name: str, dead_times: tuple[float, ...], step: float = 0.01, lag: float = 0.04) -> Recording:
    """Return a valve that answers one step after the other with these dead times [s]."""
    time = np.arange(0.0, 20.0 * len(dead_times), 0.01)
    asked = np.where(time % 40.0 > 20.0, 30e3, 0.0)
    late = np.zeros(len(time))
    for number, dead_time in enumerate(dead_times):
        part = (time >= 20.0 * number) & (time < 20.0 * (number + 1))
        late[part] = np.interp(time[part] - dead_time, time, asked)
    given = first_order(time, late, lag, ())[0]
    given = given + np.random.default_rng(9).normal(0.0, 30.0, len(time))
    fine = np.arange(0.0, time[-1], step)
    held = asked[np.searchsorted(time, fine + 1e-9, side="right") - 1]
    columns = {"pressure_cmd_0_pa": held, "pressure_0_pa": np.interp(fine, time, given)}
    return Recording(name, fine, columns)


@pytest.mark.parametrize("step", [0.01, 0.001])
def test_the_deviation_of_a_delay_is_the_scatter_between_steps(step: float) -> None:
    late = _late("late", (0.0, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09), step)
    (finding,) = valve_findings(splits_of([late]), [])
    assert finding.effect == "line_lag"
    assert finding.parameters["dead_time"].std == pytest.approx(0.012, abs=0.004)


@pytest.mark.parametrize("step", [0.01, 0.005, 0.001])
def test_interpolated_samples_know_no_delay_better_than_readings(step: float) -> None:
    (valve,) = valves_of(_late("fine", (0.0, *[0.05] * 5), step), {})
    assert valve.timing.std >= 0.9 * 0.01 / np.sqrt(12.0)


def test_a_lag_below_the_time_between_readings_is_none() -> None:
    known, late = _late("known", (0.0, *[0.0] * 5), lag=0.04), _late("late", (0.0, *[0.05] * 5), lag=0.041)
    (finding,) = valve_findings(splits_of([late]), splits_of([known]))
    assert finding.parameters["lag"].value == 0.0
    assert finding.parameters["dead_time"].value == pytest.approx(0.05, abs=0.011)


def test_what_nominal_recordings_show_as_well_is_not_new() -> None:
    law = (-700.0, 0.0, 0.0, np.inf)
    known = splits_of([_recording("known", 0.05, 0.06, law)])
    assert valve_findings(splits_of([_recording("again", 0.05, 0.06, law)]), known) == ()
    (finding,) = valve_findings(splits_of([_recording("slow", 0.05, 0.2, law)]), known)
    assert finding.effect == "line_lag"
    assert finding.parameters["lag"].value == pytest.approx(0.14, abs=0.05)
    assert finding.probability is not None
    assert 0.99 < finding.probability <= 1.0


def test_a_valve_that_has_become_quicker_is_named_as_well() -> None:
    late, quick = (splits_of([_recording(f"{lag}", 0.1, lag)]) for lag in (0.12, 0.05))
    for suspects, nominal, change in ((quick, late, -0.07), (late, quick, 0.07)):
        (finding,) = valve_findings(suspects, nominal)
        assert finding.effect == "line_lag"
        both = sum(finding.parameters[name].value for name in ("lag", "dead_time"))
        assert both == pytest.approx(change, abs=0.005)
        assert f"{1e3 * change:+.0f} ms from nominal recordings" in finding.statement


def test_a_ceiling_and_a_dead_band_are_told() -> None:
    found = valve_findings(splits_of([_recording("weak", law=(0.0, 0.0, 0.0, 45e3))]), [])
    assert [f.effect for f in found] == ["pressure_saturation"]
    assert found[0].parameters["ceiling"].value == pytest.approx(45e3, abs=200.0)
    found = valve_findings(splits_of([_recording("stiff", law=(0.0, 0.0, 2.5e3, np.inf))]), [])
    assert [f.effect for f in found] == ["valve_deadband"]
    assert found[0].parameters["band"].value == pytest.approx(2.5e3, abs=200.0)


def test_a_valve_that_was_held_only_at_its_ceiling_says_nothing_of_its_bias() -> None:
    def held(name: str, level: float, ceiling: float) -> Recording:
        columns = {}
        for chamber, (highest, most) in enumerate([(level, ceiling), *[(30e3, np.inf)] * 5]):
            asked = np.where(TIME % 20.0 > 10.0, highest, 0.0)
            noise = np.random.default_rng(chamber).normal(0.0, 30.0, len(TIME))
            columns[f"pressure_cmd_{chamber}_pa"] = asked
            columns[f"pressure_{chamber}_pa"] = settled(asked, -750.0, 0.0, 0.0, most) + noise
        return Recording(name, TIME, columns)

    known = splits_of([held(f"known_{number}", 30e3, np.inf) for number in range(4)])
    levels = (20e3, 25e3, 30e3, 45e3, 50e3, 55e3)
    found = valve_findings(splits_of([held(f"run_{level:g}", level, 38e3) for level in levels]), known)
    assert [finding.effect for finding in found] == ["pressure_saturation"]


def test_a_staircase_of_short_holds_shows_a_dead_band() -> None:
    def climbed(name: str, band: float) -> Recording:
        steps = np.floor(TIME / 0.9) % 7.0 * 1300.0
        asked = np.interp(TIME, TIME + 0.05, steps)
        given = first_order(TIME, settled(asked, -400.0, 0.0, band, np.inf), 0.05, ())[0]
        given = given + np.random.default_rng(8).normal(0.0, 30.0, len(TIME))
        return Recording(name, TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})

    (finding,) = valve_findings(splits_of([climbed("stairs", 2600.0)]), splits_of([climbed("known", 0.0)]))
    assert finding.effect == "valve_deadband"
    assert finding.parameters["band"].value == pytest.approx(2600.0, abs=150.0)


def test_a_ceiling_shows_across_recordings_of_one_level_each() -> None:
    runs = []
    for level in (10e3, 45e3, 52e3, 60e3):
        asked = np.where((TIME > 10.0) & (TIME < 40.0) | (TIME > 50.0), level, 0.0)
        noise = np.random.default_rng(3).normal(0.0, 30.0, len(TIME))
        given = np.where(asked > 0.0, np.minimum(asked, 30e3), 0.0) + noise
        runs.append(Recording(f"{level:.0f}", TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given}))
    assert [f.effect for f in valve_findings(splits_of(runs), [])] == ["pressure_saturation"]


def _ramped(hold: float, reached: Callable[[np.ndarray], np.ndarray]) -> Recording:
    """Ramp a valve up to 40 kPa and to 54 kPa, each held for as long [s], and what it reaches."""
    times, levels = [0.0], [0.0]
    while times[-1] < TIME[-1]:
        for level in (40e3, 54e3):
            times += [times[-1] + step for step in np.cumsum([3.0, hold, 3.0, 1.0])]
            levels += [level, level, 0.0, 0.0]
    asked = np.interp(TIME, times, levels)
    given = first_order(TIME, reached(asked), 0.05, ())[0]
    given = given + np.random.default_rng(4).normal(0.0, 30.0, len(TIME))
    return Recording("ramped", TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})


def _held(levels: list[float], law: tuple) -> Recording:
    """Hold each level for eight seconds."""
    time = np.arange(0.0, 8.0 * len(levels), 0.02)
    asked = np.array(levels)[(time // 8.0).astype(int)]
    given = first_order(time, settled(asked, *law), 0.04, ())[0]
    given = given + np.random.default_rng(2).normal(0.0, 30.0, len(time))
    return Recording("held", time, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})


@pytest.mark.parametrize(
    ("law", "chance"),
    [
        ((-700.0, 0.0, 0.0, 45e3), 1.0 / 6.0),
        ((-3500.0, 0.0, 0.0, np.inf), None),
        ((0.0, -0.08, 0.0, np.inf), None),
    ],
)
def test_the_highest_of_many_set_points_may_show_a_ceiling_alone(law: tuple, chance: float | None) -> None:
    """A valve that is too low by some pressure, or by a share, misses all of them."""
    recording = _held([20e3, 49e3, 35e3, 28e3, 42e3, 30e3], law)
    ceilings = ceilings_of([recording])
    assert (0 in ceilings) is (chance is not None)
    found = [f for f in valve_findings(splits_of([recording]), []) if f.effect == "pressure_saturation"]
    if chance is None:
        assert not found
    else:
        assert ceilings[0].chance == pytest.approx(chance)
        assert found[0].parameters["ceiling"].value == pytest.approx(45e3, abs=200.0)
        assert found[0].probability == pytest.approx(1.0 - chance, abs=1e-3)


@pytest.mark.parametrize("hold", [0.7, 2.0])
def test_a_ceiling_shows_while_one_set_point_above_it_moves(hold: float) -> None:
    (finding,) = valve_findings(splits_of([_ramped(hold, lambda asked: np.minimum(asked, 44e3))]), [])
    assert finding.effect == "pressure_saturation"
    assert finding.parameters["ceiling"].value == pytest.approx(44e3, abs=200.0)


@pytest.mark.parametrize("hold", [0.7, 30.0])
def test_a_lost_gain_is_no_ceiling(hold: float) -> None:
    assert not ceilings_of([_ramped(hold, lambda asked: 0.88 * asked)])


def test_a_sample_between_two_set_points_shows_no_ceiling() -> None:
    """A dead band takes 3.4 kPa off each pressure; before a fall, one sample of the set-point is lower."""
    asked = np.where(TIME < 20.0, 20e3, np.where(TIME < 40.0, 39e3, 5e3))
    given = first_order(TIME, asked - 3.4e3, 0.05, ())[0] + np.random.default_rng(4).normal(
        0.0, 30.0, len(TIME)
    )
    fall = int(np.argmax(TIME >= 40.0))
    asked[fall], given[fall] = 36.5e3, given[fall - 1]
    recording = Recording("held", TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})
    assert not ceilings_of([recording])


def test_a_valve_that_was_never_held_tells_no_bias() -> None:
    held = _recording("known", law=(-700.0, 0.0, 0.0, np.inf))
    asked = 20e3 * (1.0 - np.cos(2.0 * np.pi * TIME / 20.0))
    given = settled(asked, -700.0, 0.0, 0.0, np.inf) + np.random.default_rng(2).normal(0.0, 30.0, len(TIME))
    waves = Recording("waves", TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})
    (valve,) = valves_of(waves, {})
    assert valve.law.holds == 0
    assert valve_findings(splits_of([waves]), splits_of([held])) == ()


def test_one_short_hold_is_no_bias_where_holds_scatter() -> None:
    """In closed loop a set-point rests for moments, in which valves of the same make are off by now more, now
    less. Source of the size: a real arm in closed loop, whose valves err by 0.4 kPa either way."""
    rng = np.random.default_rng(5)
    asked = 30e3 + 20e3 * np.sin(2.0 * TIME)
    columns = {}
    for chamber, (count, offset) in enumerate([(12, 0.0), (12, 0.0), (1, -1100.0)]):
        held, error = asked.copy(), np.zeros(len(TIME))
        for begin in np.linspace(3.0, 75.0, count):
            hold = (begin <= TIME) & (begin + 0.5 > TIME)
            held[hold] = held[hold][0]
            error[hold] = offset + rng.normal(0.0, 400.0)
        given = first_order(TIME, held, 0.09, ())[0] + error + rng.normal(0.0, 20.0, len(TIME))
        columns |= {f"pressure_cmd_{chamber}_pa": held, f"pressure_{chamber}_pa": given}
    found = valve_findings(splits_of([Recording("loop", TIME, columns)]), [])
    assert [f.where.chamber for f in found if f.effect == "pressure_bias"] == []


def test_a_long_hold_with_ripple_shows_its_bias() -> None:
    """The arm that swings at the valve's end makes its pressure swing by some hundred pascals."""
    asked = np.where((TIME > 10.0) & (TIME < 30.0) | (TIME > 45.0) & (TIME < 65.0), 30e3, 0.0)
    given = first_order(TIME, settled(asked, -700.0, 0.0, 0.0, np.inf), 0.04, ())[0]
    given = given + np.where(asked > 0.0, 300.0 * np.sin(0.4 * TIME), 0.0)
    given = given + np.random.default_rng(6).normal(0.0, 30.0, len(TIME))
    columns = {"pressure_cmd_0_pa": asked, "pressure_0_pa": given}
    found = valve_findings(splits_of([Recording("ripple", TIME, columns)]), [])
    (bias,) = (f.parameters["bias"] for f in found if f.effect == "pressure_bias")
    assert bias.value == pytest.approx(-700.0, abs=2.0 * bias.std)


def test_valves_that_wander_between_recordings_are_not_blamed() -> None:
    """Nominal ones lie 350 Pa apart themselves; so much more is nothing new, four times as much is."""
    known = splits_of(
        [_recording(f"known_{k}", law=(bias, 0.0, 0.0, np.inf)) for k, bias in enumerate((-450.0, -800.0))]
    )
    again, worse = (_recording("again", law=(bias, 0.0, 0.0, np.inf)) for bias in (-1000.0, -2000.0))
    assert valve_findings(splits_of([again]), known) == ()
    (finding,) = valve_findings(splits_of([worse]), known)
    assert finding.effect in ("pressure_bias", "valve_deadband")


@pytest.mark.parametrize("offset", [-2000.0, 1000.0])
def test_an_offset_that_is_there_when_vented_is_one_of_the_sensor(offset: float) -> None:
    """The valve's own error, of which the nominal recordings have the same, does not make it a dead band."""
    law = (-800.0, 0.0, 0.0, np.inf)
    known, plain = _recording("known", 0.05, 0.04, law), _recording("plain", 0.05, 0.04, law)
    shifted = plain.columns | {"pressure_0_pa": plain.columns["pressure_0_pa"] + offset}
    off = Recording("off", TIME, shifted)
    (finding,) = valve_findings(splits_of([off]), splits_of([known]))
    assert (finding.effect, finding.when) == ("pressure_bias", "constant")
    assert finding.confusable_with == ()
    assert finding.parameters["bias"].value == pytest.approx(offset, abs=60.0)
    assert "open or vented" in finding.statement
    found = _diagnosed(off, (known,))
    assert found.verdict == "explained"
    assert found.unexplained.over_nominal == pytest.approx(1.0, abs=0.05)


def test_what_was_never_read_vented_has_not_changed() -> None:
    """A sensor that is as far off in both states is no finding, even if one of them was never vented."""
    shifted, columns = {}, _recording("plain").columns
    for name, open_always in (("off", False), ("known", True)):
        asked = np.maximum(columns["pressure_cmd_0_pa"], 10e3 if open_always else 0.0)
        given = asked + 1000.0 + np.random.default_rng(6).normal(0.0, 30.0, len(TIME))
        shifted[name] = Recording(name, TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})
    assert valve_findings(splits_of([shifted["off"]]), splits_of([shifted["known"]])) == ()


@pytest.mark.parametrize(("nominal", "gain"), [(0.0, -0.1), (-0.1, -0.1), (0.05, -0.1)])
def test_a_valve_that_delivers_a_share_of_its_set_point_is_named(nominal: float, gain: float) -> None:
    few = _recording("few", law=(0.0, gain, 0.0, np.inf))
    known = [_recording("known", law=(0.0, nominal, 0.0, np.inf))] if nominal else []
    found = valve_findings(splits_of([few]), splits_of(known))
    if nominal == gain:
        assert found == ()
        return
    (finding,) = found
    assert (finding.effect, finding.where) == ("chamber_gain", Place(chamber=0))
    assert finding.parameters["gain"].value == pytest.approx((1.0 + gain) / (1.0 + nominal) - 1.0, abs=0.003)


@pytest.mark.parametrize(("gain", "noted"), [(0.25, True), (0.0, False)])
def test_a_sensor_that_reads_a_share_is_one_fault_with_the_gain_that_makes_up_for_it(
    gain: float, noted: bool
) -> None:
    faults = valve_findings(splits_of([_recording("low", law=(0.0, -0.2, 0.0, np.inf))]), [])
    arm = replace(faults[0], parameters={"gain": Quantity(gain, 0.03, "1")})
    notes = wrong_sensors([arm], faults)
    assert bool(notes) is noted
    if noted:
        assert (
            "Chamber 0: its pressure reads 0.80 times its set-point, and the arm moves as by 1.25" in notes[0]
        )


def test_no_law_is_judged_by_readings_that_it_has_seen() -> None:
    """Of 80 readings while the valve is open too few lie in the first half to learn a law from."""
    time = np.arange(0.0, 8.0, 0.1)
    asked = np.where(time % 4.0 > 2.0, 30e3, 10e3)
    recording = Recording("short", time, {"pressure_cmd_0_pa": asked, "pressure_0_pa": asked - 900.0})
    assert valves_of(recording, {})
    assert splits_of([recording]) == []


def test_an_offset_of_the_sensor_shows_where_it_cancels_a_dead_band() -> None:
    low = _recording("low", law=(0.0, 0.0, 2500.0, np.inf))
    off = Recording("off", TIME, low.columns | {"pressure_0_pa": low.columns["pressure_0_pa"] + 2400.0})
    band, bias = valve_findings(splits_of([off]), [])
    assert (band.effect, bias.effect) == ("valve_deadband", "pressure_bias")
    assert band.parameters["band"].value == pytest.approx(2500.0, abs=200.0)
    assert bias.parameters["bias"].value == pytest.approx(2400.0, abs=60.0)


def test_a_valve_that_passes_less_than_nominal_has_a_dead_band_rather_than_a_bias() -> None:
    """A dead band only lowers a pressure, a bias that comes up lowers or raises it."""
    known = splits_of([_recording("known", law=(-800.0, 0.0, 0.0, np.inf))])
    asked = np.where(TIME % 20.0 > 10.0, 30e3, 0.0)
    given = settled(asked, -2000.0, 0.0, 0.0, np.inf) + np.random.default_rng(4).normal(0.0, 30.0, len(TIME))
    low = splits_of([Recording("low", TIME, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})])
    (finding,) = valve_findings(low, known)
    assert (finding.effect, finding.when) == ("valve_deadband", "pressure level")
    assert finding.parameters["band"].value == pytest.approx(1200.0, abs=100.0)
    assert [rival.effect for rival in finding.confusable_with] == ["pressure_bias"]
    assert finding.probability == pytest.approx(2.0 / 3.0, abs=0.005)
    (alone,) = valve_findings(low, [])
    assert alone.effect == "pressure_bias"
    assert [rival.effect for rival in alone.confusable_with] == ["valve_deadband"]
    assert alone.probability == pytest.approx(0.5, abs=0.005)


PLAIN, BIASED = (0.0, 0.0, 0.0, np.inf), (900.0, 0.0, 0.0, np.inf)


LAGS_BY_CHANCE = np.array(
    [
        [0.094, 0.111, 0.101, 0.112, 0.113, 0.103],
        [0.096, 0.106, 0.106, 0.096, 0.109, 0.107],
        [0.113, 0.108, 0.106, 0.104, 0.107, 0.100],
        [0.115, 0.112, 0.100, 0.112, 0.101, 0.111],
        [0.105, 0.104, 0.097, 0.112, 0.106, 0.096],
    ]
)
"""Lags of six valves in five recordings of one state, whose dead times are drawn anew at each change [s]."""


def test_one_of_six_valves_is_not_blamed_for_what_one_in_six_does_by_chance() -> None:
    recordings = []
    for number, lags in enumerate(LAGS_BY_CHANCE):
        columns = {}
        for chamber, lag in enumerate(lags.tolist()):
            one = _recording("valve", lag=lag).columns
            columns |= {name.replace("_0_", f"_{chamber}_"): values for name, values in one.items()}
        recordings.append(Recording(f"run_{number}", TIME, columns))
    assert valve_findings(splits_of(recordings[2:]), splits_of(recordings[:2])) == ()


def _diagnosed(recording: Recording, nominal: tuple[Recording, ...] = ()):
    admitted = Admitted((recording,), nominal, ())
    splits, known = splits_of([recording]), splits_of(nominal)
    return valve_diagnosis("sopra", admitted, splits, valve_findings(splits, known), known)


def _swinging(name: str, size: float, law: tuple = (0.0, 0.0, 0.0, np.inf), seed: int = 7) -> Recording:
    """Return a pressure that swings about its set-point: nothing that a lag or a bias describes."""
    plain = _recording(name, law=law)
    rng = np.random.default_rng(seed)
    swing = size * np.sin(2.0 * np.pi * TIME / 0.7) + rng.normal(0.0, 30.0, len(TIME))
    return Recording(name, TIME, plain.columns | {"pressure_0_pa": plain.columns["pressure_0_pa"] + swing})


def test_what_a_valves_law_leaves_in_nominal_recordings_as_well_is_not_new() -> None:
    known = _swinging("known", 1200.0)
    again = _diagnosed(_swinging("again", 1200.0, seed=8), (known,))
    assert again.verdict == "consistent"
    assert again.findings == ()
    assert again.unexplained.over_nominal == pytest.approx(1.0, abs=0.05)
    worse = _diagnosed(_swinging("worse", 3600.0), (known,))
    assert worse.verdict == "unexplained"
    assert worse.unexplained.over_nominal == pytest.approx(3.0, abs=0.1)


def test_an_unexplained_valve_is_an_unknown_finding() -> None:
    found = _diagnosed(_swinging("swinging", 1200.0))
    (finding,) = found.findings
    assert (finding.effect, finding.where, finding.when) == ("unknown", Place(chamber=0), "pressure level")


def test_nominal_recordings_of_other_valves_only_are_named() -> None:
    plain = _recording("known")
    other = {name.replace("_0_", "_1_"): values for name, values in plain.columns.items()}
    known = Recording("known", plain.time, other)
    with pytest.raises(InputError, match=r"hold the valves of chamber 1, these those of chamber 0"):
        _diagnosed(_recording("off", law=BIASED), (known,))
    both = Recording("both", plain.time, plain.columns | other)
    (note,) = not_compared(splits_of([both]), splits_of([known]))
    assert "the valves of chamber 0" in note
    assert not_compared(splits_of([both]), splits_of([both])) == ()


def test_a_steady_error_is_a_bias() -> None:
    (finding,) = valve_findings(splits_of([_recording("off", law=BIASED)]), [])
    assert finding.effect == "pressure_bias"
    assert finding.parameters["bias"].value == pytest.approx(900.0, abs=60.0)
    assert finding.confusable_with == ()  # a dead band would lower the pressure


def test_valves_that_nominal_recordings_leave_out_are_not_judged() -> None:
    plain = _recording("known")
    other = {name.replace("_0_", "_1_"): values for name, values in plain.columns.items()}
    known = splits_of([Recording("known", plain.time, other)])
    assert valve_findings(splits_of([_recording("off", law=BIASED)]), known) == ()


def test_a_set_point_slightly_above_the_highest_pressure_is_no_ceiling() -> None:
    law = (0.0, 0.0, 0.0, 57.5e3)
    assert valve_findings(splits_of([_recording("short", law=law)]), []) == ()


def test_a_valve_that_stays_shut_later_is_not_judged() -> None:
    plain = _recording("early")
    lost = plain.time > 30.0
    columns = {name: np.where(lost, np.nan, values) for name, values in plain.columns.items()}
    columns["pressure_cmd_0_pa"][-1] = 20e3  # opened once more, but nothing was measured then
    assert splits_of([Recording("early", plain.time, columns)]) == []
    with pytest.raises(InputError, match=r"early: no valve can be judged: .*; record at least 20 s"):
        _diagnosed(Recording("early", plain.time, columns))


@pytest.mark.parametrize(
    ("law", "verdict", "effects"),
    [(PLAIN, "consistent", []), (BIASED, "explained", ["pressure_bias"])],
)
def test_recordings_of_valves_alone_get_a_verdict(law: tuple, verdict: str, effects: list[str]) -> None:
    found = _diagnosed(_recording("bench", law=law))
    assert found.verdict == verdict
    assert [finding.effect for finding in found.findings] == effects
    assert found.heldout.before == pytest.approx(np.hypot(30.0, law[0]) / 30.0, rel=0.1)
    assert found.heldout.after == pytest.approx(1.0, rel=0.1)
    assert found.heldout.channels["pressure_0"].after == pytest.approx(30.0, rel=0.1)
    assert any("valves alone" in note for note in found.notes)


@pytest.mark.parametrize(("law", "verdict"), [(PLAIN, "unexplained"), (BIASED, "partly_explained")])
def test_what_a_valves_law_leaves_is_unexplained(law: tuple, verdict: str) -> None:
    found = _diagnosed(_swinging("swinging", 1200.0, law))
    assert found.verdict == verdict
    assert found.unexplained.normalised_rms > LEFT_OVER


@pytest.mark.parametrize(
    ("alone", "together"),
    [
        ("consistent", "explained"),
        ("unexplained", "partly_explained"),
        ("explained", "explained"),
    ],
)
def test_a_valves_fault_explains_its_part_of_an_arms_verdict(alone: str, together: str) -> None:
    arm = replace(_diagnosed(_recording("plain")), verdict=alone)
    faults = _diagnosed(_recording("off", law=BIASED)).findings
    assert arm.with_faults(faults).verdict == together
    assert arm.with_faults(faults).findings == faults
    assert arm.with_faults(()) is arm
    unknown = replace(arm, findings=faults)  # whatever the arm's own findings are, they stay
    assert unknown.with_faults(faults).findings == (*faults, *faults)

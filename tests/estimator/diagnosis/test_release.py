"""Arms that are held, let go and vibrate: the pose at rest, and the frequency as one more measurement."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.analysis.diagnosis.run import vibration_frequency
from softarm.estimator.diagnosis import choose
from softarm.estimator.diagnosis.candidates import Candidate
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.natural_frequency import (
    ONE_POSE,
    SIGMA,
    NaturalFrequency,
    natural_frequency_of,
)
from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.release import RINGS, find_release
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.effects import EFFECTS
from softarm.estimator.errors import InputError
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, session
from tests.estimator.simulation.straight_arm import STIFFNESS

FREQUENCY, HELD, LET_GO = 4.0, 0.3, 1.0
MASS = 0.05


def released(seconds: float = 6.0, held: float = HELD, pressure: float = 0.0) -> Session:
    """A session whose tip is held at 0.3 rad, let go at ``LET_GO`` and vibrates about its rest at zero."""
    plain = session("run", 0)
    time = np.arange(0.0, seconds, 0.02)
    since = np.maximum(time - LET_GO, 0.0)
    vibration = held * np.exp(-1.5 * since) * np.cos(2.0 * np.pi * FREQUENCY * since)
    readings = np.zeros((len(time), 4))
    readings[:, 2] = vibration
    return replace(
        plain,
        clock=50.0 + time,
        start=50.0,
        pressures=np.full((len(time), 6), pressure),
        gravity=np.zeros((len(time), 3)),
        wrenches=np.zeros((len(time), 2, 6)),
        readings=readings,
        blocks=np.zeros(len(time), dtype=np.int64),
        heldout=np.zeros(len(time), dtype=bool),
    )


def sampled(rate: float, frequency: float) -> Session:
    """Release an arm that vibrates at some frequency, recorded at some rate."""
    time = np.arange(0.0, 4.0, 1.0 / rate)
    plain = released(seconds=0.02 * len(time))
    since = np.maximum(time - LET_GO, 0.0)
    readings = np.zeros((len(time), 4))
    readings[:, 2] = HELD * np.exp(-1.5 * since) * np.cos(2.0 * np.pi * frequency * since)
    return replace(plain, clock=time, readings=readings)


def test_an_arm_that_was_let_go_is_judged_once_its_vibration_has_decayed() -> None:
    found = find_release(released(), FREQUENCY)
    assert found is not None
    assert found.time == pytest.approx(LET_GO, abs=0.05)
    assert found.session.natural_frequency == FREQUENCY
    rest = found.session.clock[0] - 50.0
    assert rest == pytest.approx(found.time + RINGS / FREQUENCY, abs=0.021)
    assert np.abs(found.session.readings).max() < 0.1 * HELD


@pytest.mark.parametrize(
    ("recorded", "natural_frequency"),
    [
        (released(), None),
        (released(pressure=5e3), FREQUENCY),
        (released(held=0.0), FREQUENCY),
    ],
    ids=["no vibration", "driven by pressures", "still"],
)
def test_what_is_no_release_is_judged_whole(recorded: Session, natural_frequency: float | None) -> None:
    assert find_release(recorded, natural_frequency) is None


def test_an_arm_that_moves_from_the_start_was_not_held() -> None:
    vibrating = released()
    assert find_release(vibrating.thin(vibrating.clock > 50.0 + LET_GO), FREQUENCY) is None


def fit_of(name: str, size: float, deviation: float, place: Place) -> Fit:
    effect = EFFECTS[name]
    covariance = np.array([[(deviation / effect.parameters[0].scale) ** 2]])
    return Fit((Hypothesis(effect, place),), (np.array([size]),), covariance, 100.0)


TIP, LOWER = Place(section="tip"), Place(segment="lower")


def test_a_payload_lowers_the_frequency_and_a_stiffer_segment_raises_it() -> None:
    frequency = NaturalFrequency(0.0, MASS)
    payload, stiffer = fit_of("tip_payload", 0.03, 1.0, TIP), fit_of("segment_stiffness", 0.44, 1.0, LOWER)
    assert frequency.predicted(payload.hypotheses, payload.thetas) == pytest.approx(0.5 * np.log(0.05 / 0.08))
    assert frequency.predicted(stiffer.hypotheses, stiffer.thetas) == pytest.approx(np.log(1.2))


@pytest.mark.parametrize(("name", "place"), [("chamber_gain", Place(chamber=0)), ("external_force", TIP)])
def test_a_force_or_a_gain_changes_no_frequency(name: str, place: Place) -> None:
    effect = EFFECTS[name]
    theta = np.array([p.typical for p in effect.parameters])
    assert NaturalFrequency(-0.1, MASS).predicted([Hypothesis(effect, place)], [theta]) == 0.0


def test_a_frequency_moves_a_size_by_the_rule_of_bayes() -> None:
    """For a change that is small the logarithm of the ratio is linear: -m / (2 M)."""
    deviation, mass = 1e-3, 2e-3
    prior = fit_of("tip_payload", mass, deviation, TIP)
    frequency = NaturalFrequency(-0.5 * (mass + 1e-3) / MASS, MASS)
    conditioned = frequency.conditioned(prior)
    slope, spread = -0.5 / MASS, deviation**2 + (ONE_POSE * mass) ** 2
    variance = 1.0 / (1.0 / spread + slope**2 / SIGMA**2)
    expected = variance * (mass / spread + slope * frequency.ratio / SIGMA**2)
    assert conditioned.thetas[0][0] == pytest.approx(expected, rel=0.02)
    assert conditioned.stds(0)[0] ** 2 == pytest.approx(variance, rel=0.1)


def test_a_frequency_that_contradicts_a_payload_costs_it_its_gain() -> None:
    payload = fit_of("tip_payload", 0.03, 1e-4, TIP)
    predicted = NaturalFrequency(0.0, MASS).predicted(payload.hypotheses, payload.thetas)
    agreeing, contrary = (
        NaturalFrequency(ratio, MASS).conditioned(payload).gain for ratio in (predicted, 0.0)
    )
    assert agreeing == pytest.approx(100.0 + predicted**2 / SIGMA**2, rel=1e-3)
    assert contrary < 0.0


def test_a_payload_that_a_frequency_supports_is_fitted_on_the_model_itself(monkeypatch) -> None:
    """Both fits have gained the same by the frequency: what the model itself explains decides."""
    payload = fit_of("tip_payload", 0.03, 1e-4, TIP)
    predicted = NaturalFrequency(0.0, MASS).predicted(payload.hypotheses, payload.thetas)
    frequency = NaturalFrequency(predicted, MASS)
    search = cast(
        "Any",
        SimpleNamespace(
            natural_frequency=frequency,
            solvable=lambda _: True,
            conditioned=lambda fit, **_: frequency.conditioned(fit),
            weighed=lambda number, fit, _: Candidate(number, fit, 0.0),
        ),
    )
    exact = replace(payload, gain=payload.gain + 10.0, exact=True)
    monkeypatch.setattr(choose, "gain_of", lambda *_: payload.gain - 50.0)
    monkeypatch.setattr(choose, "fit_effects", lambda *_, **__: exact)
    first = Candidate(0, frequency.conditioned(payload), 0.0)
    assert Search.resolved(search, first, cast("Any", None), None).fit.exact


def test_no_frequency_makes_a_mass_negative() -> None:
    conditioned = NaturalFrequency(0.3, MASS).conditioned(fit_of("tip_payload", 0.001, 0.05, TIP))
    assert conditioned.thetas[0][0] == pytest.approx(0.0, abs=1e-9)


@pytest.fixture(scope="module")
def stages() -> list[Stage]:
    fitted = calibrate_sessions(model(), [session("nominal", 0, nominal=True)])
    still = released().thin(np.arange(300) < 20)
    frequencies = {True: 2.0, False: 1.8}
    return [
        fitted.stage(model(), replace(still, nominal=nominal, natural_frequency=frequency))
        for nominal, frequency in frequencies.items()
    ]


def test_two_frequencies_give_their_ratio_and_the_modal_mass(stages: list[Stage]) -> None:
    """Across the straight arm, a force at the tip bends both segments: c = sum of lever^2 / stiffness."""
    frequency = natural_frequency_of(stages)
    assert frequency is not None
    assert frequency.ratio == pytest.approx(np.log(0.9))
    factors = stages[0].setting.scales
    compliance = sum(
        (0.27 - joint) ** 2 / (STIFFNESS[k, 0] * factors[name])
        for k, (joint, name) in enumerate(((0.065, "upper"), (0.20, "lower")))
    )
    assert frequency.mass == pytest.approx(1.0 / (compliance * (2.0 * np.pi * 2.0) ** 2), rel=0.02)


def test_without_a_nominal_frequency_there_is_nothing_to_compare(stages: list[Stage]) -> None:
    assert natural_frequency_of(stages[1:]) is None
    silent = [replace(one, session=replace(one.session, natural_frequency=None)) for one in stages]
    assert natural_frequency_of(silent) is None


def test_a_recording_that_ends_before_the_arm_rests_is_refused() -> None:
    with pytest.raises(InputError, match=r"let go at 1.02 s, .* ends 1.96 s later, .* of 4.0 Hz") as said:
        find_release(released(seconds=LET_GO + RINGS / FREQUENCY), FREQUENCY)
    assert "record at least 2.4 s after the release" in str(said.value)


@pytest.mark.parametrize("rate", [20.0, 50.0, 240.0])
def test_the_frequency_of_a_vibration_is_found_at_any_rate_that_resolves_it(rate: float) -> None:
    found = vibration_frequency(sampled(rate, FREQUENCY))
    assert found == pytest.approx(FREQUENCY, abs=0.3)
    assert vibration_frequency(sampled(rate, 0.4)) is None

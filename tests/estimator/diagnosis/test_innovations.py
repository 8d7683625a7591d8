"""Errors by channel, the test for white noise and the worst stretch, on residuals that are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from softarm.estimator.diagnosis.innovations import (
    channel_errors,
    innovation_test,
    worst_over_nominal,
    worst_stretch,
)
from softarm.estimator.diagnosis.line import line_errors
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.weights import Weights
from tests.estimator.diagnosis.linear_arm import session

ASSUMED = 0.01
BENDS = ("bend_intermediate.x", "bend_intermediate.y", "bend_tip.x", "bend_tip.y")


@pytest.fixture(scope="module")
def search():
    """The parts of a search that are read: two sessions, the second one in question, half of it held out."""
    known, asked = session("known", 1, nominal=True), session("run", 2)
    asked = replace(asked, heldout=asked.blocks % 2 == 0)
    stages = [stage(one, np.zeros((one.samples, 4))) for one in (known, asked)]
    assert channels(asked.suite) == BENDS
    return SimpleNamespace(
        evidence=SimpleNamespace(stages=stages), weights=Weights(dict.fromkeys(BENDS, ASSUMED), 1.0)
    )


def stage(one, model_error_std):
    """Stand for a stage of which only the noise is asked."""
    return SimpleNamespace(
        session=one, suite=one.suite, error_std=lambda scale: np.hypot(scale, model_error_std)
    )


def noise(search, size: float, memory: float = 0.0) -> list[np.ndarray]:
    """Draw residuals of a first-order autoregressive process with a standard deviation and a correlation."""
    rng = np.random.default_rng(4)
    found = []
    for stage in search.evidence.stages:
        left = rng.normal(0.0, size, (stage.session.samples, 4))
        for k in range(1, len(left)):
            left[k] = memory * left[k - 1] + np.sqrt(1.0 - memory**2) * left[k]
        found.append(left)
    return found


def test_a_line_is_learnt_outside_held_out_data_and_judged_on_what_is_reported():
    made = session("run", 2)
    slopes = np.linspace(-2e-6, 2e-6, made.pressures.shape[1])
    line = made.pressures @ slopes + 0.1
    asked = replace(made, heldout=made.blocks % 2 == 0)
    readings = np.where(asked.heldout, line + 0.03, line)[:, None] * np.ones(4)
    readings[::5] = np.nan
    errors = line_errors([replace(asked, readings=readings)])
    assert errors == pytest.approx(dict.fromkeys(BENDS, 0.03))
    assert line_errors([replace(asked, readings=readings, nominal=True)]) == {}
    unpressed = replace(asked, readings=readings, pressures=np.zeros((made.samples, 0)))
    assert line_errors([unpressed]) == {}, "an arm without chambers follows no pressures"


def test_white_noise_of_the_assumed_size_has_variance_1_and_no_correlation(search):
    test = innovation_test(search, *2 * [noise(search, ASSUMED)])
    assert set(test.variance) == set(test.correlation) == set(BENDS)
    assert list(test.variance.values()) == pytest.approx([1.0] * 4, abs=1.0)  # over that of as few samples
    assert list(test.correlation.values()) == pytest.approx([0.0] * 4, abs=0.35)


def test_noise_that_is_larger_and_correlated_shows_in_the_residuals(search):
    test = innovation_test(search, *2 * [noise(search, 3.0 * ASSUMED, memory=0.9)])
    assert min(test.residual_variance.values()) > 3.0
    assert min(test.residual_correlation.values()) > 0.6


def test_innovations_show_what_other_stretches_have_not_shown(search):
    left = noise(search, ASSUMED)
    left[1][search.evidence.stages[1].session.heldout] *= 3.0
    assert min(innovation_test(search, left, left).variance.values()) > 4.0


def test_what_a_vibration_leaves_uncertain_counts_in_the_assumed_noise(search):
    doubtful = [
        stage(s.session, np.full((s.session.samples, 4), np.sqrt(3.0) * ASSUMED))
        for s in search.evidence.stages
    ]
    other = SimpleNamespace(evidence=SimpleNamespace(stages=doubtful), weights=search.weights)
    left = noise(search, ASSUMED)
    whole, half = (innovation_test(one, left, left).residual_variance for one in (search, other))
    assert half == pytest.approx({name: value / 4.0 for name, value in whole.items()})


def test_errors_are_those_of_held_out_samples_of_recordings_in_question(search):
    first, last = noise(search, ASSUMED), noise(search, ASSUMED)
    seen = ~search.evidence.stages[1].session.heldout
    first[0][:], first[1][seen], first[1][~seen] = 9.0, 9.0, 0.04
    last[0][:], last[1][seen], last[1][~seen] = 9.0, 9.0, -0.01
    first[1][np.flatnonzero(~seen)[0], 0] = np.nan
    errors = channel_errors(search, first, last)
    assert {name: (e.unit, e.before, e.after) for name, e in errors.items()} == {
        name: ("rad", pytest.approx(0.04), pytest.approx(0.01)) for name in BENDS
    }


def test_the_worst_stretch_is_found_by_recording_channel_and_time(search):
    left = noise(search, 0.1 * ASSUMED)
    left[0][:] = 5.0  # a nominal recording is not in question
    asked = search.evidence.stages[1].session
    chosen = asked.blocks == asked.blocks[asked.samples // 2]
    left[1][chosen, 2] = 0.3
    worst = worst_stretch(search, left)
    time = asked.time[chosen]
    assert (worst.recording, worst.channel, worst.unit) == ("run", "bend_tip.x", "rad")
    assert (worst.start, worst.end) == (time[0], time[-1])
    assert worst.rms == pytest.approx(0.3)


@pytest.mark.parametrize(("reported", "ratio"), [(False, 30.0), (True, 1.0)])
def test_the_worst_stretch_is_compared_with_the_worst_nominal_one(search, *, reported: bool, ratio: float):
    """One axis errs in one stretch; what is for the report decides nothing."""
    stages = list(search.evidence.stages)
    blocks = stages[1].session.blocks
    worst = blocks == blocks[0]
    hidden = replace(stages[1].session, heldout=worst, confirms=worst & (not reported))
    stages[1] = stage(hidden, np.zeros((len(blocks), 4)))
    residuals = [np.full((one.session.samples, 4), ASSUMED) for one in stages]
    residuals[1][worst, 2] *= 30.0
    residuals[1][:3, 0] = np.nan
    columns = [np.zeros((one.session.samples, 4, 1)) for one in stages]
    made = SimpleNamespace(
        evidence=SimpleNamespace(stages=stages, columns=columns),
        weights=search.weights,
        prior=SimpleNamespace(mean=np.zeros(1)),
        left=lambda _: SimpleNamespace(
            residuals=residuals, folds=SimpleNamespace(whole=SimpleNamespace(mean=np.zeros(1)))
        ),
    )
    assert worst_over_nominal(made, None) == pytest.approx(ratio)
    alone = SimpleNamespace(
        **(vars(made) | {"evidence": SimpleNamespace(stages=stages[1:], columns=columns[1:])})
    )
    alone.left = lambda _: SimpleNamespace(residuals=residuals[1:], folds=made.left(None).folds)
    assert worst_over_nominal(alone, None) == 0.0

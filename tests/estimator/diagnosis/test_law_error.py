"""What the error of a strong effect's law may look like does not count for a weaker effect; the rest does."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis.fit import Fit, MarginalisedProblem, RecordingResidual, gain_of
from softarm.estimator.diagnosis.law_error import SHARE, gain_beside_law_errors, gradient_covariance
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import world

RECORDINGS, SAMPLES, ROWS = 4, 300, 3
STRONG, WEAK = (
    Hypothesis(EFFECTS["tip_payload"], Place(section="tip")),
    Hypothesis(EFFECTS["segment_stiffness"], Place(segment="lower")),
)


def problem_of(*, of_its_own: bool) -> tuple[MarginalisedProblem, Fit]:
    """Build residuals of a strong effect and of what a second one fits: a law error, or something else."""
    rng = np.random.default_rng(5)
    residuals = []
    for _ in range(RECORDINGS):
        strong = 10.0 * np.cumsum(rng.normal(size=(SAMPLES, ROWS)), axis=0) / np.sqrt(SAMPLES)
        error = strong * rng.normal(0.0, SHARE, ROWS)
        weak = 0.5 * rng.normal(size=(SAMPLES, ROWS)) if of_its_own else error
        by = {"tip_payload": strong, "segment_stiffness": weak}
        stage = SimpleNamespace(
            world=world(()),
            change=lambda placed, by=by, **_: sum(by[p.effect.name] * p.theta[0] for p in placed),
        )
        left = strong + weak + rng.normal(size=(SAMPLES, ROWS))
        blank = np.zeros((left.size, 1), dtype=np.float32)
        residuals.append(RecordingResidual(cast("Any", stage), left, np.ones_like(left), blank))
    problem = MarginalisedProblem.alone(residuals)
    fit = Fit((STRONG, WEAK), (np.ones(1), np.ones(1)), np.eye(2), 0.0)
    return problem, fit


@pytest.mark.parametrize("of_its_own", [True, False])
def test_only_what_no_error_of_the_others_law_explains_counts(of_its_own: bool) -> None:
    problem, fit = problem_of(of_its_own=of_its_own)
    plain = gain_of(problem, fit.hypotheses, fit.thetas) - gain_of(
        problem, fit.hypotheses[:1], fit.thetas[:1]
    )
    beside = gain_beside_law_errors(problem, fit, 1)
    assert plain > 500.0
    if of_its_own:
        assert beside == pytest.approx(plain, rel=0.05)
    else:
        assert abs(beside) < 2.0 * RECORDINGS * ROWS


def test_how_another_sensor_reads_is_exact() -> None:
    """What one sensor's own error may get wrong explains nothing that another one shows."""
    problem, fit = problem_of(of_its_own=False)
    sensor = Hypothesis(EFFECTS["sensor_scale"], Place(sensor="tip_frame"))
    exact = Fit((sensor, fit.hypotheses[1]), fit.thetas, fit.covariance, 0.0)
    for recorded in problem.residuals:
        by, stage = recorded.stage.change, cast("Any", recorded.stage)
        stage.change = lambda placed, by=by, **_: sum(
            by([SimpleNamespace(effect=STRONG.effect, theta=p.theta)])
            if p.effect.name == "sensor_scale"
            else by([p])
            for p in placed
        )
        stage.world = replace(stage.world, sensors=("tip_frame",))
    plain = gain_of(problem, exact.hypotheses, exact.thetas) - gain_of(
        problem, exact.hypotheses[:1], exact.thetas[:1]
    )
    assert gain_beside_law_errors(problem, exact, 1) == pytest.approx(plain)


def test_beside_no_other_effect_the_gain_is_that_of_the_fit() -> None:
    problem, fit = problem_of(of_its_own=True)
    alone = fit.selected([0])
    plain = gain_of(problem, alone.hypotheses, alone.thetas)
    assert gain_beside_law_errors(problem, alone, 0) == pytest.approx(plain)


def test_a_size_scatters_as_the_error_of_its_law_makes_it() -> None:
    """The law is wrong by another share in each channel of each recording."""
    problem, fit = problem_of(of_its_own=True)
    alone = fit.selected([0])
    changes = [recorded.stage.change([SimpleNamespace(effect=STRONG.effect, theta=np.ones(1))])
               for recorded in problem.residuals]  # fmt: skip
    slopes = [change.reshape(-1, 1) for change in changes]
    information = sum(float((slope**2).sum()) for slope in slopes)
    (variance,) = gradient_covariance(problem, alone, slopes)[0] / information**2
    rng = np.random.default_rng(8)
    sizes = []
    for _ in range(2000):
        wrong = [change * (1.0 + rng.normal(0.0, SHARE, ROWS)) for change in changes]
        pull = sum(float((own * change).sum()) for own, change in zip(wrong, changes, strict=True))
        sizes.append(pull / information)
    assert np.sqrt(variance) == pytest.approx(np.std(sizes), rel=0.06)
    sensor = Hypothesis(EFFECTS["sensor_scale"], Place(sensor="tip_frame"))
    exact = Fit((sensor,), (np.ones(1),), np.eye(1), 0.0)
    assert not gradient_covariance(problem, exact, slopes).any()

"""Sizes and their uncertainty where the truth is known: errors that last, and a regressor that errs."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis import sizes
from softarm.estimator.diagnosis.candidates import (
    Accepted,
    Candidate,
    ChosenEffects,
)
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.fit import Fit, MarginalisedProblem
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.library import Hypothesis, Library
from softarm.estimator.diagnosis.sizes import (
    DECIDES,
    Part,
    fragments,
    plain_residuals,
    reversed_sign,
    robust_covariance,
    sized,
    without_fragments,
)
from softarm.estimator.diagnosis.weights import Weights
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import fit_of, hypothesis
from tests.estimator.simulation.straight_arm import world

SAMPLES, NOISE = 400, 1e-3
RUNS = 6
MASS = 0.03
NO_ERROR = np.zeros((1, 1))


def part(x: np.ndarray, left: np.ndarray, common: np.ndarray) -> Part:
    return Part(x.T @ x, x.T @ left, x.T @ common)


def test_independent_errors_give_the_variance_of_least_squares():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(RUNS, SAMPLES, 2))
    parts = [part(own, rng.normal(size=SAMPLES), np.zeros((SAMPLES, 1))) for own in x]
    found = robust_covariance(parts, np.zeros(2), np.zeros((1, 1)), np.zeros((2, 2)), 1.0)
    whole = np.linalg.inv(np.einsum("rsi,rsj->ij", x, x))
    assert np.diag(found) / np.diag(whole) == pytest.approx(
        [2.0, 2.0], rel=0.6
    )  # the jackknife counts it again


def test_fewer_independent_samples_and_uncertain_common_coefficients_widen_it():
    x, nothing = np.ones((SAMPLES, 1)), np.zeros(SAMPLES)
    parts = [part(x, nothing, x)] * RUNS
    plain = robust_covariance(parts, np.zeros(1), np.zeros((1, 1)), NO_ERROR, 1.0)[0, 0]
    assert robust_covariance(parts, np.zeros(1), np.zeros((1, 1)), NO_ERROR, 0.1)[0, 0] == pytest.approx(
        10.0 * plain
    )
    common = robust_covariance(parts, np.zeros(1), np.full((1, 1), 0.2), NO_ERROR, 1.0)[0, 0]
    assert common == pytest.approx(plain + 0.2)


def test_an_error_that_lasts_for_a_recording_counts():
    """Estimates of single recordings scatter by 0.5: their mean by 0.5 over the root of their number."""
    rng = np.random.default_rng(1)
    x = np.ones((SAMPLES, 1))
    own = rng.normal(0.0, 0.5, 40)
    parts = [part(x, np.full(SAMPLES, size - own.mean()), 0.0 * x) for size in own]
    found = robust_covariance(parts, np.zeros(1), np.zeros((1, 1)), NO_ERROR, 1.0)[0, 0]
    assert np.sqrt(found) == pytest.approx(own.std(ddof=1) / np.sqrt(40), rel=0.1)


class Weighed:
    """A stage on which a payload changes the reading in proportion, by a shape that the model gets wrong."""

    def __init__(self, seed: int, *, nominal: bool = False) -> None:
        rng = np.random.default_rng(seed)
        truth = np.sin(np.linspace(0.0, 7.0, SAMPLES) + rng.uniform(0.0, 6.0))[:, None]
        self.world = world(("frame_tip",))
        self.shape = truth + 0.3 * rng.normal(size=truth.shape)
        self.common = truth + 0.02 * rng.normal(size=truth.shape)
        self.session = SimpleNamespace(nominal=nominal, heldout=np.zeros(SAMPLES, dtype=bool))
        self.residual = (0.0 if nominal else MASS) * truth + NOISE * rng.normal(size=truth.shape)

    def error_std(self, scale: np.ndarray) -> np.ndarray:
        return np.broadcast_to(scale, self.residual.shape)

    def change(self, effects, *, exact: bool = False, **_: object) -> np.ndarray:
        sensing = sum(float(one.theta[0]) for one in effects if one.effect.hook == "sensing")
        return self.shape * (sum(float(one.theta[0]) for one in effects) - sensing) + sensing


class Recorded(SimpleNamespace):
    """Recordings of a diagnosis, as far as sizes need them."""

    has_nominal = RegressionProblem.has_nominal


@pytest.fixture
def search() -> Search:
    stages = [Weighed(0, nominal=True), *(Weighed(seed) for seed in range(1, RUNS + 1))]
    evidence = Recorded(
        stages=stages,
        residuals=[stage.residual for stage in stages],
        columns=[stage.common[..., None].astype(np.float32) for stage in stages],
        names=[("x",)] * len(stages),
    )
    weights = Weights({"x": NOISE}, 0.1)
    prior = Gaussian(np.zeros(1), np.full((1, 1), 1e-3**2))
    found = cast(
        "Search",
        SimpleNamespace(
            evidence=evidence,
            weights=weights,
            prior=prior,
            natural_frequency=None,
            solvable=lambda _, **__: False,
            problem=lambda: MarginalisedProblem.alone(plain_residuals(found)[0], 0.1),
        ),
    )
    return found


def fitted() -> Fit:
    payload = Hypothesis(EFFECTS["tip_payload"], Place(section="tip"))
    return Fit((payload,), (np.array([0.01]),), np.eye(1) * 1e-12, 50.0)


def test_the_truth_lies_within_two_deviations_of_a_size_though_the_model_errs(search):
    found = sized(search, fitted())
    size, deviation = float(found.thetas[0][0]), float(found.stds(0)[0])
    assert size == pytest.approx(MASS, rel=0.2)
    assert abs(size - MASS) < 2.0 * deviation + 0.16 * MASS  # what 30 % of error in the regressor costs
    assert found.gain == 50.0


@pytest.mark.parametrize(("answer", "size"), [(0.8, MASS / 0.8), (0.0, MASS)])
def test_the_model_itself_tells_sizes_unless_it_explains_much_less(search, monkeypatch, answer, size):
    """To first order and on the model itself the arm fits as well, with another size."""
    monkeypatch.setattr(search, "solvable", lambda _, **__: True)
    plain = Weighed.change

    def change(stage, placed, *, exact=False, **_):
        return plain(stage, placed) * (answer if exact else 1.0)

    monkeypatch.setattr(Weighed, "change", change)
    found = sized(search, fitted())
    assert found.exact is (answer > 0.0)
    assert float(found.thetas[0][0]) == pytest.approx(size, rel=0.2)


def biased(size: float, covariance: float = 1e-4) -> Fit:
    """A fit of an offset of a sensor."""
    bias = Hypothesis(EFFECTS["sensor_bias"], Place(sensor="frame_tip"))
    return Fit((bias,), (np.array([size, 0.0]),), np.eye(2) * covariance, 50.0)


def test_what_a_sensor_does_alone_stays_as_the_search_found_it(search):
    alone = biased(0.02)
    assert sized(search, alone) is alone


def test_what_a_sensor_does_is_as_certain_as_the_other_laws_allow(search):
    """Beside a payload whose law errs by three tenths."""
    search.evidence.residuals = [residual + 4e-3 for residual in search.evidence.residuals]
    both = replace(fitted().joined(biased(3e-3)), covariance=np.eye(3))
    found = sized(search, both)
    size, deviation = float(found.thetas[1][0]), float(found.stds(1)[0])
    assert abs(size - 4e-3) < 2.0 * deviation
    assert deviation < 1e-3
    assert float(found.thetas[0][0]) == pytest.approx(MASS, rel=0.2)
    assert found.scaled_covariance(0) != pytest.approx(np.eye(1))


def test_without_nominal_recordings_the_sizes_stay(search):
    search.evidence.stages[0].session.nominal = False
    fit = fitted()
    assert sized(search, fit) is fit


@pytest.mark.parametrize(("left", "factor"), [(0.5, 1.0), (9.0, 3.0)])
def test_what_is_left_widens_the_deviations_of_walls_alone(left: float, factor: float):
    tip = Place(section="tip")
    hypotheses = tuple(Hypothesis(EFFECTS[name], tip) for name in ("tip_payload", "contact_obstacle"))
    fit = Fit(hypotheses, (np.array([0.02]), np.array([50.0, 0.03, 0.5])), np.eye(4), 1.0, False)
    assert sizes.contact_deviations(fit, left) == pytest.approx([1.0, factor, factor, factor])


def test_a_size_of_the_other_sign_is_no_estimate_of_the_same_effect():
    fit = fitted()
    assert not reversed_sign(fit, replace(fit, thetas=(np.array([0.05]),)))
    assert reversed_sign(fit, replace(fit, thetas=(np.array([-0.001]),)))
    force = Hypothesis(EFFECTS["external_force"], Place(section="tip"))
    pulled = Fit((force,), (np.array([0.2, 0.01, 0.0, 0.0]),), np.eye(4), 1.0)
    assert not reversed_sign(pulled, replace(pulled, thetas=(np.array([0.2, -0.01, 0.0, 0.0]),)))


def test_a_size_that_turns_out_reversed_stays_and_is_less_certain(search):
    """The choice saw a weaker chamber, where these columns would make it a stronger one."""
    weaker = Hypothesis(EFFECTS["chamber_gain"], Place(chamber=0))
    fit = Fit((weaker,), (np.array([-0.02]),), np.eye(1) * 1e-12, 50.0)
    found = sized(search, fit)
    assert found.thetas[0][0] == -0.02
    assert found.stds(0)[0] > 1e-4


def test_a_shape_stays_and_is_no_less_certain_than_beforehand(search):
    """Here the width of a softening changes nothing, so only its prior limits it."""
    softer = Hypothesis(EFFECTS["mullins_softening"], Place(segment="lower"))
    fit = Fit((softer,), (np.array([0.01, 0.5, 0.2]),), np.eye(3) * 1e-6, 50.0)
    found = sized(search, fit)
    assert found.thetas[0][0] == pytest.approx(MASS, rel=0.2)
    assert found.thetas[0][1:].tolist() == [0.5, 0.2]
    assert found.scaled_stds(0)[1] == pytest.approx(softer.effect.parameters[1].spread, rel=0.01)


def test_the_weakest_of_doubtful_effects_is_taken_back_first(monkeypatch):
    names = ("tip_payload", "chamber_gain", "segment_stiffness")
    places = (Place(section="tip"), Place(chamber=0), Place(segment="lower"))
    hypotheses = tuple(Hypothesis(EFFECTS[n], p) for n, p in zip(names, places, strict=True))
    fit = Fit(hypotheses, (np.array([0.1]),) * 3, 1e-4 * np.eye(3), 100.0)
    gains = {"tip_payload": 90.0, "chamber_gain": 20.0, "segment_stiffness": 10.0}
    choice = SimpleNamespace(fit=fit, accepted=tuple(SimpleNamespace(name=name, field=()) for name in names))

    def less(choice, lost):
        kept = [k for k in range(len(choice.accepted)) if k not in lost]
        return SimpleNamespace(
            fit=choice.fit.selected(kept), accepted=tuple(choice.accepted[k] for k in kept)
        )

    monkeypatch.setattr(sizes, "sized", lambda _, own: replace(own, gain=1.0))
    monkeypatch.setattr(sizes, "gain_beside_law_errors", lambda _, own, k: gains[own.hypotheses[k].name])
    gained = SimpleNamespace(
        without=less,
        contribution=lambda own, k: gains[own.hypotheses[k].name],
        problem=lambda: None,
        bic_penalty=0.0,
        evidence=SimpleNamespace(has_nominal=True),
        natural_frequency=None,
    )
    left, _, dropped = without_fragments(cast("Search", gained), cast("Any", choice))
    assert dropped == ["segment_stiffness", "chamber_gain"]
    assert [one.name for one in left.accepted] == ["tip_payload"]


@pytest.mark.parametrize(("deviation", "expected"), [(0.02, "line_lag"), (0.001, "line_leak")])
def test_a_leak_that_is_not_distinguishable_from_none_is_a_late_line(monkeypatch, deviation, expected):
    """The search saw a share of a hundredth with a deviation of a thousandth."""
    place = Place(chamber=1)

    def fit_of(name: str, theta: list[float]) -> Fit:
        covariance = 1e-6 * np.eye(len(theta))
        return Fit((Hypothesis(EFFECTS[name], place),), (np.array(theta),), covariance, 50.0)

    leak, lag = fit_of("line_leak", [0.01, 0.2, 2.0]), fit_of("line_lag", [0.25])
    late, leaking = Candidate(1, lag, 80.0), Candidate(0, leak, 90.0)
    accepted = Accepted(leaking, cast("Any", None), (leaking,))
    choice = ChosenEffects((accepted,), leak, 0.0, None)

    def honest(_search, own):
        if own.hypotheses[0].name == "line_lag":
            return replace(own)
        scales = np.array([p.scale for p in own.hypotheses[0].effect.parameters])
        return replace(own, covariance=np.diag([deviation / scales[0], 0.02 / scales[1], 1.0]) ** 2)

    monkeypatch.setattr(sizes, "sized", honest)
    monkeypatch.setattr(sizes, "gain_beside_law_errors", lambda *_: 110.0)
    search = SimpleNamespace(
        exchanged=lambda own, _, one: replace(own, accepted=(replace(accepted, candidate=one),), fit=one.fit),
        contribution=lambda *_: 90.0,
        problem=lambda: None,
        left_free=lambda _: SimpleNamespace(problem=lambda: None),
        bic_penalty=5.0,
        subset=lambda *_: None,
        candidate=lambda number, theta, *_: late if (number, theta.tolist()) == (1, [0.2]) else None,
        evidence=SimpleNamespace(
            has_nominal=True, library=Library((leak.hypotheses[0], lag.hypotheses[0]), ())
        ),
        natural_frequency=None,
    )
    left, _, dropped = without_fragments(cast("Search", search), choice)
    assert left.fit is not None
    assert [h.name for h in left.fit.hypotheses] == [expected]
    assert left.accepted[0].candidate is (late if expected == "line_lag" else leaking)
    assert not dropped


@pytest.mark.parametrize(("beside", "lost"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize("contributions", [[100.0, 80.0], [80.0, 100.0]])
def test_an_effect_has_to_explain_more_than_the_others_laws_may_leave(
    monkeypatch, contributions, beside, lost
):
    """A force along a stiffer arm gains more than the stiffness, and little where its law may err."""
    both, penalty = fit_of("tip_payload", 1.0).joined(fit_of("line_lag", 1.0)), 5.0

    def beside_errors(_problem, fit, number):
        assert fit is both
        return (beside if number else 2.0) * DECIDES + penalty

    monkeypatch.setattr(sizes, "gain_beside_law_errors", beside_errors)
    search = SimpleNamespace(
        contribution=lambda _, k: contributions[k], problem=lambda: None, bic_penalty=penalty
    )
    found = fragments(cast("Any", search), both)
    assert found == ({1: pytest.approx(beside * DECIDES)} if lost else {})


def of_sensor(name: str, sensor: str, *theta: float) -> Fit:
    return replace(fit_of(name, *theta), hypotheses=(hypothesis(name, Place(sensor=sensor)),))


LIGHT, SCALED = fit_of("tip_payload", 0.002), of_sensor("sensor_scale", "bend_tip", 0.1)


@pytest.mark.parametrize(
    ("fit", "lost"),
    [
        (LIGHT, []),
        (LIGHT.joined(SCALED), [1]),
        (of_sensor("sensor_drift", "bend_tip", 0.001, 0.0).joined(SCALED), [0, 1]),
        (of_sensor("sensor_drift", "bend_intermediate", 0.001, 0.0).joined(SCALED), []),
    ],
)
def test_a_weak_effect_may_be_what_the_law_of_another_one_leaves(monkeypatch, fit, lost):
    """What a sensor does to its own readings leaves nothing for the arm and other sensors to explain."""
    monkeypatch.setattr(sizes, "gain_beside_law_errors", lambda *_: 2.0 * DECIDES)
    search = SimpleNamespace(contribution=lambda *_: 0.9 * DECIDES, problem=lambda: None, bic_penalty=5.0)
    assert list(fragments(cast("Any", search), fit)) == lost

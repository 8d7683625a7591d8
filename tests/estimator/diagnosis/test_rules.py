"""The rules of the choice, each on numbers of which it is known what they should decide."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis import choose, confirm, diagnose, explanations, sizes
from softarm.estimator.diagnosis.candidates import (
    ALIKE,
    MOST_SURPRISE,
    SIGNIFICANT_Z,
    Accepted,
    Candidate,
    ChosenEffects,
    includes,
    is_distinguishable,
    is_moved,
    plainest_first,
    restates,
    surprise,
)
from softarm.estimator.diagnosis.choose import DELAY_SHARE, FINALISTS, SECOND, Search
from softarm.estimator.diagnosis.conclude import unknown
from softarm.estimator.diagnosis.confirm import lost_by_chance, unproven
from softarm.estimator.diagnosis.diagnose import Decision
from softarm.estimator.diagnosis.explanations import undecided, without_improbable
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.folds import Folds
from softarm.estimator.diagnosis.gaussian import NOTHING, Gaussian
from softarm.estimator.diagnosis.judge import (
    CERTAIN,
    FoldCosts,
    Judgement,
    bootstrap,
    fold_costs,
    judge,
)
from softarm.estimator.diagnosis.library import Direction, Hypothesis, Library
from softarm.estimator.diagnosis.marginal import Marginal, null_draws
from softarm.estimator.diagnosis.nominal import MATERIAL, evidence_of_change, passive, prior_before
from softarm.estimator.diagnosis.normal_equations import (
    NewColumns,
    NormalEquations,
    normal_equations,
    with_columns,
)
from softarm.estimator.diagnosis.probability import CREDIBLE, probabilities
from softarm.estimator.diagnosis.result import Heldout, Rival, Unexplained
from softarm.estimator.diagnosis.screen import null_scores, screen, usual_gains
from softarm.estimator.diagnosis.sizes import DECIDES, fragments
from softarm.estimator.diagnosis.unnamed import UnnamedLaw
from softarm.estimator.diagnosis.weights import weights_of
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place

SAMPLES, RUNS = 60, 5
TIP = Place(section="tip")


def hypothesis(name: str, place: Place = TIP) -> Hypothesis:
    return Hypothesis(EFFECTS[name], place)


def fit_of(name: str, *theta: float, deviation: float = 1e-3, gain: float = 100.0) -> Fit:
    scales = np.array([parameter.scale for parameter in EFFECTS[name].parameters])
    covariance = np.diag((deviation / scales) ** 2)
    return Fit((hypothesis(name),), (np.array(theta),), covariance, gain)


def candidate(fit: Fit, delta_bic: float, number: int = 0) -> Candidate:
    return Candidate(number, fit, delta_bic)


def judgement(**changes: Any) -> Judgement:
    usual: dict[str, Any] = {
        "before": 3.0, "after": 1.0, "gain_ci95": (0.3, 0.7), "share": 0.8, "change": 2.0,
        "search_p": 0.0, "delta_bic": 30.0,
    }  # fmt: skip
    return Judgement(**(usual | changes))


@pytest.mark.parametrize(
    ("changes", "accepted"),
    [
        ({}, True),
        ({"gain_ci95": (-0.1, 0.7)}, False),
        ({"gain_ci95": (0.0, 0.7)}, True),
        ({"gain_ci95": (-0.1, 0.7), "delta_bic": 1.01 * CERTAIN}, True),
        ({"gain_ci95": (-0.1, 0.7), "delta_bic": 1.01 * CERTAIN, "after": 3.1}, False),
        ({"share": 0.05}, True),
        ({"share": 0.05, "change": 0.5}, False),
        ({"search_p": 0.02}, False),
    ],
)
def test_a_candidate_is_accepted_where_it_holds_is_material_and_no_chance(changes, accepted):
    assert judgement(**changes).accepted is accepted


def recordings(sizes: list[float], noise: float = 1.0) -> list[NormalEquations]:
    """Recordings with one common column, and one of a candidate whose size differs between them."""
    found = []
    for number, size in enumerate(sizes):
        rng = np.random.default_rng([7, number])
        columns = rng.normal(size=(SAMPLES, 1, 2))
        residual = size * columns[..., 1] + noise * rng.normal(size=(SAMPLES, 1))
        none = np.zeros(SAMPLES, dtype=bool)
        blocks = np.zeros(SAMPLES, dtype=int)
        found += normal_equations(residual, columns, np.ones(1), blocks, none, none, number, nominal=False)
    return found


def judged_on(parts: list[NormalEquations]) -> Judgement:
    common = [replace(part, matrix=part.matrix[:1, :1], vector=part.vector[:1]) for part in parts]
    new = [NewColumns(part.matrix[:1, 1:], part.matrix[1:, 1:], part.vector[1:]) for part in parts]
    folds = Folds.of(common, Gaussian(np.zeros(1), 1e-4 * np.eye(1)), 1.0)
    changed = np.array([sum(new[k].matrix[0, 0] for k in fold) for fold in folds.numbers])
    costs = fold_costs(folds.marginal(folds.columns(new)), NOTHING, changed)
    return judge(costs, np.random.default_rng(0), 0.0, 50.0)


def judged(sizes: list[float]) -> Judgement:
    return judged_on(recordings(sizes))


def test_a_size_that_every_recording_shows_predicts_the_others():
    found = judged([2.0] * RUNS)
    assert found.after == pytest.approx(1.0, abs=0.15)
    assert found.before == pytest.approx(np.sqrt(5.0), rel=0.15)
    assert found.accepted


def test_sizes_that_contradict_each_other_are_not_one_effect():
    found = judged([2.0, -2.0, 2.0, -2.0, 2.0])
    assert found.after > found.before
    assert not found.accepted


def test_nothing_is_no_effect():
    assert not judged([0.0] * RUNS).accepted


def test_the_bootstrap_of_a_gain_covers_it():
    rng = np.random.default_rng(1)
    before, after = rng.chisquare(50, 12) * 4.0, rng.chisquare(50, 12)
    low, high = bootstrap(rng, before, after)
    assert low < 1.0 - np.sqrt(after.sum() / before.sum()) < high
    assert high - low < 0.2


def test_a_cord_that_a_fit_makes_as_stiff_as_a_wall_is_no_cord():
    """An obstacle may be rigid and a cord without stiffness; the upper bound of a cord is another law."""
    upper = EFFECTS["tether_stiffness"].parameters[0].upper
    rigid = EFFECTS["contact_obstacle"].parameters[0].upper
    cord, wall = (
        fit_of("tether_stiffness", upper, 0.02, 0.0, 0.5),
        fit_of("contact_obstacle", rigid, 0.02, 0.0),
    )
    both = replace(cord.joined(wall), covariance=1e-6 * np.eye(7))
    assert [both.is_bounded(k) for k in range(2)] == [True, False]
    assert not fit_of("tether_stiffness", 0.9 * upper, 0.02, 0.0, 0.5).is_bounded(0)
    assert not fit_of("tether_stiffness", 0.0, 0.02, 0.0, 0.5).is_bounded(0)
    accepted = [
        Accepted(candidate(one, 100.0, number), judgement(), ()) for number, one in enumerate((cord, wall))
    ]
    search = SimpleNamespace(
        contribution=lambda *_: 100.0, subset=lambda fit, kept: fit.selected(kept), refit=lambda fit: fit
    )
    kept, left, dropped = Search.pruned(cast("Any", search), accepted, both)
    assert kept == accepted[1:]
    assert left is not None
    assert [h.name for h in left.hypotheses] == ["contact_obstacle"]
    assert dropped == {0}


def test_where_only_an_effect_at_its_bound_explains_anything_it_is_turned_down():
    """Something acts then, which is asked for a name; to take no notice of it would be to miss it."""
    heaviest = candidate(fit_of("tip_payload", EFFECTS["tip_payload"].parameters[0].upper), 100.0)
    found = judgement(delta_bic=100.0)
    search = SimpleNamespace(
        another_vibration=lambda *_: False,
        another_stretch=lambda *_: False,
        likely=lambda *_: [],
        judge=lambda *_: found,
    )
    assert Search.best(cast("Any", search), [heaviest], None, np.zeros(5), []) == (None, (heaviest, found))
    hardly = replace(heaviest, delta_bic=1.0)
    assert Search.best(cast("Any", search), [hardly], None, np.zeros(5), []) == (None, None)


def test_an_unexpected_size_costs_up_to_a_bound():
    spread = EFFECTS["tip_payload"].parameters[0].spread
    assert surprise(fit_of("tip_payload", 2.0 * spread)) == pytest.approx(4.0)
    assert surprise(fit_of("tip_payload", 20.0 * spread)) == MOST_SURPRISE


def test_of_equals_the_plainest_comes_first():
    plain, rich = fit_of("tip_payload", 0.01), fit_of("tether_stiffness", 5.0, 0.01, 0.0, 0.5)
    close = [candidate(rich, 100.0), candidate(plain, 100.0 - 0.9 * ALIKE)]
    assert plainest_first(close)[0].fit is plain
    apart = [candidate(rich, 100.0), candidate(plain, 100.0 - 1.1 * ALIKE)]
    assert plainest_first(apart)[0].fit is rich
    assert plainest_first([]) == []


def test_only_what_predicts_the_folds_about_as_well_as_the_best_may_be_accepted():
    """A gain in the fit does not make up for folds predicted worse; of equals the plainest is first."""
    gains = {0: np.full(5, 360.0), 1: np.full(5, 400.0), 2: np.full(5, 399.8)}
    none = np.full(5, 400.0)
    search = SimpleNamespace(
        rng=np.random.default_rng(0),
        bic_penalty=5.0,
        predicted=lambda one, _: FoldCosts(none, none, none, none, gains[one.number], 0.0 * none),
        only_moves=lambda _: False,
    )
    fits = [fit_of("tip_payload", 0.01), fit_of("line_leak", 0.1, 0.1, 1.0), fit_of("tip_payload", 0.01)]
    field = [candidate(fit, 100.0 - 10.0 * number, number) for number, fit in enumerate(fits)]
    likely = Search.likely(cast("Any", search), field, None)
    assert [one.number for one in likely] == [2, 1]
    heaviest = fit_of("tip_payload", EFFECTS["tip_payload"].parameters[0].upper)
    bound = [*field[:2], replace(field[2], fit=heaviest)]
    assert [one.number for one in Search.likely(cast("Any", search), bound, None)] == [1]
    assert Search.likely(cast("Any", search), [], None) == []


@pytest.mark.parametrize(("least", "sure"), [(0.0, True), (4000.0, False)])
def test_a_hundredth_of_the_gain_makes_nobody_sure(least, *, sure):
    """A law that is a tenth wrong leaves as much in all folds; the same gain over nothing decides."""
    none = np.full(5, 400.0)
    costs = [
        FoldCosts(none, none, none, none, np.full(5, total / 5), 0.0 * none)
        for total in (least, least + 40.0)
    ]
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    likelier = probabilities(field, costs, 5.0, np.random.default_rng(0))[1]
    assert bool(likelier > CREDIBLE) is sure
    assert likelier > 0.5


@pytest.mark.parametrize(("usual", "likeliest"), [(0.0, 0), (300.0, 1), (2000.0, 1)])
def test_explanations_are_compared_with_what_every_arm_may_have_of_them(usual, likeliest):
    """Most of a drift every arm may have; it still explains more than a lost gain that no arm has."""
    none = np.full(5, 400.0)
    gains = (np.full(5, 40.0), np.full(5, 20.0))
    shares = (np.zeros(5), np.full(5, usual / 5))
    costs = [FoldCosts(none, none, none, none, *one) for one in zip(gains, shares, strict=True)]
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    probable = probabilities(field, costs, 5.0, np.random.default_rng(0))
    assert probable[likeliest] > 0.9
    likely = Search.likely(
        cast(
            "Any",
            SimpleNamespace(
                rng=np.random.default_rng(0),
                bic_penalty=5.0,
                predicted=lambda one, _: costs[one.number],
                only_moves=lambda _: False,
            ),
        ),
        field,
        None,
    )
    assert likely[0].number == likeliest


def test_no_change_is_likeliest_where_a_usual_share_explains_as_much():
    none = np.full(5, 400.0)
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    gains, shares = (np.full(5, 40.0), np.zeros(5)), (np.zeros(5), np.full(5, 60.0))
    costs = [FoldCosts(none, none, none, none, *one) for one in zip(gains, shares, strict=True)]
    assert probabilities(field, costs, 5.0, np.random.default_rng(0)).sum() < 0.1


def test_an_effect_on_the_stiffness_begins_at_the_size_that_explains_most(library):
    """Its slope at zero is that of a frequency, which a large change has long left behind."""
    hypotheses = (hypothesis("tip_payload", TIP), hypothesis("segment_stiffness", Place(segment="upper")))
    typical = EFFECTS["segment_stiffness"].parameters[0].typical
    search = SimpleNamespace(
        evidence=SimpleNamespace(library=Library(hypotheses, library.directions[:0])),
        bic_penalty=6.0,
        starts={},
    )
    gains = {2.0 * typical: 200.0, typical: 110.0}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choose, "gain_of", lambda _, __, thetas, *, exact: gains.get(thetas[0][0], -700.0))
        ranked, problem = [(0, 120.0, np.ones(1)), (1, 76.0, np.ones(1))], cast("Any", None)
        found = Search.at_size(cast("Any", search), ranked, problem)
        gains[typical] = 900.0
        again = Search.at_size(cast("Any", search), ranked, problem)
    assert [(number, score) for number, score, _ in found] == [(1, 194.0), (0, 120.0)]
    assert found[0][2].tolist() == [2.0 * typical]
    assert [score for _, score, _ in again] == [194.0, 120.0]  # beside others it begins where it began before


def test_effects_detune_an_arm_if_they_change_its_stiffness_its_damping_or_what_it_stands_on():
    detuning = {name for name, effect in EFFECTS.items() if effect.detunes}
    laws = {
        "material_softening",
        "material_stiffening",
        "mullins_softening",
        "viscoelastic_creep",
        "hysteresis",
    }
    stiffness = {"segment_stiffness", "thermal_drift", "local_stiffness_defect", "base_compliance"}
    assert detuning == laws | stiffness | {"inertia_damping"}


def test_sizes_are_tried_within_bounds_and_leave_shapes_alone():
    parameters = EFFECTS["thermal_drift"].parameters
    change, time = (one.typical for one in parameters)
    tried = [one.tolist() for one in choose.at_typical_sizes(parameters, np.array([0.0, 0.5 * time]))]
    assert tried == [[size * change, 0.5 * time] for size in choose.SIZES]
    narrow = replace(parameters[0], lower=-1.5 * change)
    assert (
        len(choose.at_typical_sizes((narrow, parameters[1]), np.array([0.0, time]))) == len(choose.SIZES) - 1
    )


@pytest.mark.parametrize(
    ("usual", "nominal", "fitted"), [(1e3, True, True), (1.0, True, False), (1e3, False, False)]
)
def test_what_explains_most_as_usual_is_fitted_as_well(library, usual, nominal, fitted):
    """A drift that every arm may have leaves little to a change of it, and so ranks low."""
    hypotheses = tuple(hypothesis("line_lag", Place(chamber=k)) for k in range(FINALISTS))
    library = Library((*hypotheses, hypothesis("tip_payload", TIP)), library.directions[:0])
    ranked = [(k, 50.0 - k, np.ones(1)) for k in range(FINALISTS + 1)]
    search = SimpleNamespace(evidence=SimpleNamespace(library=library, has_nominal=nominal))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choose, "usual_gains", lambda *_: {"tip_payload": usual, "line_lag": 0.5})
        found = Search.nominated(cast("Any", search), ranked, cast("Any", None))
    assert [number for number, *_ in found] == list(range(FINALISTS + fitted))


def test_what_a_usual_share_of_each_effect_explains():
    evidence = cast("Any", SimpleNamespace(nuisances=1, effects=["tip_payload", "hysteresis", "hysteresis"]))
    shift, covariance = np.array([9.0, 1.0, 0.2, 3.0]), np.diag([1.0, 1.0, 0.01, 0.5])
    marginal = Marginal(np.eye(4), np.zeros(4), 500.0, 400.0, shift, covariance)
    assert usual_gains(evidence, marginal) == pytest.approx({"tip_payload": 1.0, "hysteresis": 22.0})


def test_an_unlikely_size_makes_an_explanation_less_probable():
    none = np.full(5, 400.0)
    costs = [FoldCosts(none, none, none, none, np.full(5, 20.0), 0.0 * none)] * 2
    spread = EFFECTS["tip_payload"].parameters[0].spread
    field = [candidate(fit_of("tip_payload", size * spread), 100.0, 0) for size in (0.1, 2.0)]
    usual, unlikely = probabilities(field, costs, 5.0, np.random.default_rng(0))
    assert usual > 5.0 * unlikely


def test_the_natural_frequency_counts_where_the_arm_at_rest_looks_alike():
    """A weight and a force bend the arm alike; only the weight changes how fast it vibrates."""
    none = np.full(5, 400.0)
    search = SimpleNamespace(
        rng=np.random.default_rng(0),
        bic_penalty=5.0,
        predicted=lambda one, _: FoldCosts(
            none, none, none, none, none, 0.0 * none, (0.0, 1500.0)[one.number]
        ),
        only_moves=lambda _: False,
    )
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    likely = Search.likely(cast("Any", search), field, None)
    assert [one.number for one in likely] == [1]


def test_an_amplitude_is_distinguishable_from_zero_by_its_deviation():
    assert is_distinguishable(fit_of("tip_payload", 1.1 * SIGNIFICANT_Z, deviation=1.0), 0)
    assert not is_distinguishable(fit_of("tip_payload", 0.9 * SIGNIFICANT_Z, deviation=1.0), 0)


@pytest.mark.parametrize("told", [0.9, 1.1])
def test_a_law_with_a_free_exponent_is_judged_by_its_likelihood(told):
    """Softening at small bends: amplitude and exponent trade against each other, and either is unsure."""
    law = hypothesis("material_softening", Place(segment="lower"))
    growth, exponent = 2.0, 1.5
    bends = np.linspace(0.05, 0.3, 40)
    shown = growth * bends**exponent
    scales = [law.effect.parameters[0].scale, exponent]  # the exponent is fitted as a logarithm
    slopes = np.column_stack([bends**exponent, shown * np.log(bends)]) * scales
    two = 11.83  # of chi-square with two degrees of freedom, as improbable as three deviations of one
    noise = np.sqrt(float(shown @ shown) / two) / np.sqrt(told)
    covariance = noise**2 * np.linalg.inv(slopes.T @ slopes)
    fit = Fit((law,), (np.array([growth, exponent]),), covariance, 100.0)
    assert growth / fit.stds(0)[0] < 1.5
    assert is_distinguishable(fit, 0) is (told > 1.0)


@pytest.fixture
def library() -> Library:
    directions = (
        Direction(0, 0, 0, np.array([0.01]), 0.01, 0.02),
        Direction(1, 0, 0, np.array([2.5, 0.01, 0.0]), 2.5, 5.0),
        Direction(2, 0, 0, np.array([0.04]), 0.04, 0.08),
    )
    places = (TIP, TIP, Place(chamber=1))
    names = ("tip_payload", "tether_stiffness", "chamber_gain")
    return Library(tuple(map(hypothesis, names, places)), directions)


def test_the_screen_ranks_by_gain_and_refuses_sizes_of_the_wrong_sign(library):
    evidence = cast("Any", SimpleNamespace(nuisances=0, library=library))
    marginal = Marginal(
        np.diag([100.0, 100.0, 100.0]), np.array([40.0, -80.0, 60.0]), 500.0, 400.0, np.zeros(3), np.eye(3)
    )
    ranked = screen(evidence, marginal, frozenset())
    assert [number for number, *_ in ranked] == [2, 0, 1]
    assert ranked[0][1] == pytest.approx(36.0 - np.log(400.0), rel=1e-4)
    assert ranked[0][2] == pytest.approx([0.6 * 0.08], rel=1e-4)
    assert ranked[-1][1] < 0.0  # a cord does not push
    assert {number for number, *_ in screen(evidence, marginal, frozenset({2}))} == {0, 1}


def test_chances_of_the_search_are_even_or_cautious_where_nothing_is_missing(library):
    evidence = cast("Any", SimpleNamespace(nuisances=0, library=library))
    rng = np.random.default_rng(2)
    root = rng.normal(size=(3, 3))
    matrix = 50.0 * (root @ root.T + np.eye(3))
    plain = Marginal(matrix, np.zeros(3), 500.0, 400.0, np.zeros(3), np.eye(3))
    null = null_scores(evidence, plain, rng)
    chances = []
    for drawn in null_draws(plain.matrix, rng, 400):
        marginal = Marginal(matrix, drawn, 500.0, 400.0, np.zeros(3), np.eye(3))
        best = screen(evidence, marginal, frozenset())[0][1]
        chances.append(float((null >= best).mean()))
    for level in (0.01, 0.05, 0.2):
        assert np.mean(np.array(chances) <= level) < level + 3.0 * np.sqrt(level / 400.0)


def test_the_noise_is_learnt_by_channel_and_thinned_by_its_memory():
    rng = np.random.default_rng(3)
    white, slow = rng.normal(0.0, 0.5, 4000), rng.normal(size=4000)
    for k in range(1, 4000):
        slow[k] += 0.9 * slow[k - 1]
    weights = weights_of([("a", "b")], [np.stack([white, slow], axis=1)], [np.array([0.1, 20.0])])
    assert weights.scale["a"] == pytest.approx(0.5, rel=0.05)
    assert weights.scale["b"] == 20.0  # never below the sensor's noise
    lengths = 0.5 * (1.0 + (1.0 + 0.9) / (1.0 - 0.9))
    assert weights.effective_sample_fraction == pytest.approx(1.0 / lengths, rel=0.4)


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


def test_what_an_effect_adds_is_asked_beside_those_found_after_it(monkeypatch):
    """A denser arm gained most before the payload was found that explains the same."""
    mass, payload = fit_of("distributed_mass", 0.1), fit_of("tip_payload", 0.02)
    hysteresis = fit_of("hysteresis", 0.1, 0.3, 0.0, 0.0)
    gains = {"distributed_mass": 700.0, "tip_payload": 720.0, "hysteresis": 600.0}

    def refit(fit):
        names = [h.name for h in fit.hypotheses]
        masses = max((gains[name] for name in names if name != "hysteresis"), default=0.0)
        return replace(fit, gain=masses + ("hysteresis" in names) * gains["hysteresis"])

    every = refit(mass.joined(payload).joined(hysteresis))
    search = SimpleNamespace(
        refit=refit, bic_penalty=5.0, subset=lambda fit, kept: fit.selected(kept) if kept else None
    )
    search.contribution = lambda fit, k: Search.contribution(cast("Any", search), fit, k)
    search.worth = lambda fit: Search.worth(cast("Any", search), fit)
    assert [search.contribution(every, k) for k in range(3)] == [-5.0, 15.0, 590.0]
    assert search.contribution(refit(mass), 0) == 695.0
    monkeypatch.setattr(sizes, "gain_beside_law_errors", lambda *_: 500.0)
    search.problem = lambda: None
    assert fragments(cast("Any", search), every) == {0: -5.0, 1: 15.0}


@pytest.mark.parametrize(("stiffness", "gain"), [(25.0, np.inf), (8.0, -158.0)])
def test_a_cord_that_must_be_as_stiff_as_a_wall_states_nothing_in_its_place(stiffness, gain):
    """Without the wall the cord alone explains more than both do here, but at its bound a wall begins."""
    tip = Place(section="tip")
    wall, cord = (hypothesis(name, tip) for name in ("contact_obstacle", "tether_stiffness"))
    both = Fit((wall, cord), (wall.effect.typical, cord.effect.typical), np.eye(7), 1000.0)
    alone = Fit((cord,), (np.array([stiffness, *cord.effect.typical[1:]]),), np.eye(4), 1143.0)
    search = SimpleNamespace(
        refit=lambda _: alone, bic_penalty=5.0, subset=lambda fit, kept: fit.selected(kept) if kept else None
    )
    search.worth = lambda fit: Search.worth(cast("Any", search), fit)
    assert Search.contribution(cast("Any", search), both, 0) == gain


class ArmOfOneEffect:
    """What nominal priors read of a regression problem: one nuisance and one effect."""

    nuisances, size = 1, 2
    typical = np.ones(2)

    def __init__(self, change: float) -> None:
        self.parts = [
            part
            for number in range(6)
            for part in self._recorded(number, 0.0 if number < 3 else change, nominal=number < 3)
        ]

    def _recorded(self, number: int, change: float, *, nominal: bool) -> list[NormalEquations]:
        rng = np.random.default_rng([9, number])
        columns = rng.normal(size=(SAMPLES, 1, 2))
        truth = np.array([0.4, 0.1 + change])
        residual = columns @ truth + 0.05 * rng.normal(size=(SAMPLES, 1))
        none, blocks = np.zeros(SAMPLES, dtype=bool), np.zeros(SAMPLES, dtype=int)
        scale = np.full(1, 0.05)
        return normal_equations(residual, columns, scale, blocks, none, none, number, nominal=nominal)

    def products(self, weights: object) -> list[NormalEquations]:
        return self.parts

    def prior(self, background: float, form: float) -> Gaussian:
        return Gaussian(np.zeros(2), np.diag([1.0, background**2]))

    def sound(self) -> Gaussian:
        return self.prior(0.3, 1.0)


def change_seen(change: float) -> float:
    arm = cast("Any", ArmOfOneEffect(change))
    prior, width = prior_before(arm, cast("Any", SimpleNamespace(effective_sample_fraction=1.0)), frozenset())
    assert prior.mean == pytest.approx([0.4, 0.1], abs=0.02)
    assert width < MATERIAL
    return evidence_of_change(arm, prior, width, [part for part in arm.parts if not part.nominal], 1.0)


def test_a_change_beyond_what_differs_from_run_to_run_is_evidence():
    assert change_seen(0.0) < 0.0
    assert change_seen(0.02) < 0.0
    assert change_seen(0.5) > 20.0


@dataclass(frozen=True)
class MemoryOfMaterial:
    """What bounds of memory read of a regression problem."""

    library: Library
    nuisances: int = 1
    stages: tuple[Any, ...] = (SimpleNamespace(world=SimpleNamespace(segments=("upper", "lower"))),)

    @property
    def size(self) -> int:
        return self.nuisances + len(self.library.directions)


def test_memory_may_shrink_by_what_nominal_recordings_show_of_it_and_no_further():
    """The upper segment has 0.06 of hysteresis over all reaches, with the whole arm's; the lower one none."""
    upper, whole = (
        Hypothesis(EFFECTS["hysteresis"], Place(segment="upper")),
        Hypothesis(EFFECTS["hysteresis"], Place()),
    )
    heavy = hypothesis("distributed_mass")
    directions = (
        Direction(0, 0, 0, np.array([0.1, 0.03]), 0.1, 0.15),
        Direction(0, 1, 0, np.array([0.1, 0.3]), 0.1, 0.15),
        Direction(1, 0, 0, np.array([0.1, 0.1]), 0.1, 0.15),
        Direction(2, 0, 0, np.array([0.1]), 0.1, 0.1),
    )
    amounts = np.array([0.05, -0.01, 0.02, 0.0]) / [direction.typical for direction in directions]
    prior = Gaussian(np.array([0.7, *amounts]), np.diag([1.0, 0.0, 0.0, (0.01 / 0.15) ** 2, 1.0]))
    bounded = passive(cast("Any", MemoryOfMaterial(Library((upper, whole, heavy), directions))), prior)
    least = [one.effect.parameters[0].lower for one in bounded.library.hypotheses]
    assert least == pytest.approx([-0.06 - 0.02, -0.02 - 0.02, heavy.effect.parameters[0].lower])
    assert bounded.library.hypotheses[0].effect.parameters[1] == EFFECTS["hysteresis"].parameters[1]


def chosen(*fits: Fit, gain: float = 100.0) -> ChosenEffects:
    if not fits:
        return ChosenEffects((), None, 1.0, None)
    joint = fits[0]
    for fit in fits[1:]:
        joint = joint.joined(fit)
    accepted = tuple(Accepted(candidate(fit, gain), judgement(), ()) for fit in fits)
    return ChosenEffects(accepted, joint, 0.0, None)


@pytest.mark.parametrize(
    ("law", "named", "probability", "outdoes"),
    [
        (1000.0, 400.0, 0.96, True),
        (1000.0, 700.0, 0.99, True),  # foreign physics that a name resembles
        (1000.0, 900.0, 0.45, False),  # more, but not in all recordings
        (1000.0, 400.0, 0.55, True),
        (400.0, 1000.0, 0.0, False),
        (CERTAIN - 1.0, 0.0, 0.99, False),
    ],
)
def test_a_law_outdoes_effects_where_it_is_likelier_than_not_to_act_alone(law, named, probability, outdoes):
    assert UnnamedLaw(law, named, probability, (hypothesis("tip_payload"),), Place(), "").outdoes is outdoes


@pytest.mark.parametrize(
    ("found", "changed", "verdict"),
    [
        (True, False, "explained"),
        (True, True, "partly_explained"),
        (False, False, "consistent"),
        (False, True, "unexplained"),
    ],
)
def test_the_verdict_follows_from_findings_and_what_is_left(found, changed, verdict):
    assert Decision(chosen(), (), None, 0.0, 1.0, changed).verdict(explained=found) == verdict


def decide_on(monkeypatch, choice, one_of=(), **made):
    """Decide where the search ends so; nothing is left, and no law without a name outdoes anything."""
    usual = {
        "proven": (choice, []),
        "without_fragments": (choice, None, []),
        "unnamed_law": UnnamedLaw(0.0, 0.0, 0.0, (), Place(), ""),
        "_remainder": 1.0,
        "worst_over_nominal": 1.0,
        "_changed": False,
    }
    for name, value in (usual | made).items():
        monkeypatch.setattr(diagnose, name, lambda *_, value=value: value)
    monkeypatch.setattr(diagnose, "without_improbable", lambda _, choice, sizes, __: (choice, sizes, []))
    monkeypatch.setattr(diagnose, "undecided", lambda *_: one_of)
    return diagnose.decide(cast("Any", None))


@pytest.mark.parametrize(
    ("left", "worst", "doubt", "probability", "changed"),
    [
        (2.0, 1.0, None, 0.1, True),
        (1.0, 20.0, None, 0.1, True),
        (1.0, 10.0, None, 0.1, False),
        (1.0, 1.0, (0.0, 0.2), 0.9, True),
        (1.0, 1.0, (0.0, 0.2), 0.1, False),
        (1.0, 1.0, (0.5, 0.2), 0.9, False),
        (1.0, 1.0, (0.0, 0.05), 0.9, False),
    ],
)
def test_something_unknown_is_reported_where_much_is_left_or_a_sign_is_likelier_than_not(
    monkeypatch, left, worst, doubt, probability, changed
):
    plain = chosen()
    if doubt is not None:
        alarm, low = doubt
        turned_down = candidate(fit_of("tip_payload", 0.02), 20.0), judgement(gain_ci95=(low, 0.9))
        plain = ChosenEffects((), None, alarm, turned_down)
    signs = {"_remainder": left, "worst_over_nominal": worst}
    decision = decide_on(monkeypatch, plain, **signs, unnamed_probability=probability)
    assert decision.changed is changed


@pytest.mark.parametrize("probability", [0.9, 0.1])
def test_an_effect_that_was_found_and_disproved_is_a_sign_of_something_unknown(monkeypatch, probability):
    (disproved,) = chosen(fit_of("tip_payload", 0.02)).accepted
    decision = decide_on(
        monkeypatch, chosen(), proven=(chosen(), [disproved]), unnamed_probability=probability
    )
    assert decision.dropped == ("tip_payload",)
    assert decision.changed is (probability > 0.5)


@pytest.mark.parametrize(("gain", "once"), [(1.1 * CERTAIN, True), (3.0 * CERTAIN, False)])
def test_what_a_single_pose_shows_is_reported_without_a_name(monkeypatch, gain, once):
    """A candidate that holds in all but its number of poses is no finding, but the arm is not consistent."""
    shown = judgement(delta_bic=gain, least=2.0 * CERTAIN)
    assert shown.seen_once is once
    assert shown.accepted is not once
    turned_down = candidate(fit_of("tip_payload", 0.02), gain), shown
    decision = decide_on(monkeypatch, ChosenEffects((), None, 0.0, turned_down), unnamed_probability=0.0)
    assert decision.changed is once
    if once:
        assert decision.seen_once is not None
        finding = unknown(
            Unexplained(4.0), Heldout(4.0, 4.0, (0.0, 0.0), ""), 0.0, None, 0.0, decision.seen_once
        )
        assert finding.effect == "unknown"
        assert [one.effect for one in finding.confusable_with] == ["tip_payload"]
        assert "tip payload of the tip section" in finding.statement


def test_where_no_name_is_likelier_than_not_something_unknown_is_reported(monkeypatch):
    payload = chosen(fit_of("tip_payload", 0.02))
    rivals = (Rival("tip_payload", TIP, "the mount turned", 0.0),)
    decision = decide_on(monkeypatch, payload, rivals, without_fragments=(payload, payload.fit, []))
    assert decision.one_of == rivals
    assert decision.choice.fit is None
    assert decision.verdict(explained=False) == "unexplained"


@pytest.mark.parametrize(("probability", "rival"), [(0.6, True), (0.99, False)])
def test_the_effects_that_a_law_hardly_outdoes_are_its_rivals(*, probability: float, rival: bool) -> None:
    scale = Hypothesis(EFFECTS["sensor_scale"], Place(sensor="bend_tip"))
    law = UnnamedLaw(40.0, 36.0, probability, (scale,), Place(segment="lower"), "pose")
    finding = unknown(Unexplained(4.0), Heldout(4.0, 4.0, (0.0, 0.0), ""), 0.0, law, probability)
    assert finding.probability == probability
    rivals = [(one.effect, one.where, one.log_bayes_factor) for one in finding.confusable_with]
    assert rivals == ([("sensor_scale", Place(sensor="bend_tip"), 2.0)] if rival else [])


def searching(library: Library) -> Search:
    return Search(
        cast("Any", SimpleNamespace(library=library)),
        cast("Any", SimpleNamespace(effective_sample_fraction=1.0)),
        Gaussian(np.zeros(0), np.zeros((0, 0))),
        np.random.default_rng(0),
    )


def test_a_delay_beside_another_mass_is_its_vibration_unless_it_weighs():
    delayed = Hypothesis(EFFECTS["line_lag"], Place(chamber=0))
    search = searching(Library((hypothesis("tip_payload"), delayed), ()))
    heavy = Accepted(candidate(fit_of("tip_payload", 0.02), 1000.0, 0), judgement(), ())
    for share, vibrates in ((0.5 * DELAY_SHARE, True), (2.0 * DELAY_SHARE, False)):
        late = candidate(fit_of("line_lag", 0.1), share * 1000.0, 1)
        assert search.only_moves(late)
        assert search.another_vibration(late, [late], [heavy]) is vibrates
        assert not search.another_vibration(late, [late], [])


def test_a_delay_is_another_vibration_where_that_explains_more():
    late, swinging = Hypothesis(EFFECTS["line_lag"], Place(chamber=0)), hypothesis("inertia_damping")
    search = searching(Library((hypothesis("tip_payload"), late, swinging), ()))
    heavy = Accepted(candidate(fit_of("tip_payload", 0.02), 1000.0, 0), judgement(), ())
    vibration = candidate(fit_of("inertia_damping", 1.0, 0.1), 200.0, 2)
    for gain, vibrates in ((150.0, True), (300.0, False)):
        delay = candidate(fit_of("line_lag", 0.1), gain, 1)
        assert search.another_vibration(delay, [delay, vibration], [heavy]) is vibrates
        assert not search.another_vibration(delay, [delay, vibration], [])
    for share, consequence in ((0.9 * SECOND, True), (1.1 * SECOND, False)):
        swing = candidate(vibration.fit, share * 1000.0, 2)
        assert search.another_vibration(swing, [swing], [heavy]) is consequence


@pytest.mark.parametrize("effect", ["material_stiffening", "tip_payload", "distributed_mass"])
def test_a_force_along_the_arm_beside_what_stretches_it_is_that_stretch_unless_it_weighs(effect: str):
    along, stretching = Hypothesis(EFFECTS["external_force"], TIP), Hypothesis(EFFECTS[effect], Place())
    search = searching(Library((stretching, along), ()))
    material = Accepted(candidate(fit_of(effect, 0.5), 1000.0, 0), judgement(), ())
    for share, stretches in ((0.9 * SECOND, True), (1.1 * SECOND, False)):
        pulled = candidate(fit_of("external_force", 0.0, 0.0, 0.2, 0.0), share * 1000.0, 1)
        assert search.another_stretch(pulled, [material]) is stretches


@pytest.mark.parametrize("rival", [True, False])
@pytest.mark.parametrize(
    ("better", "worth", "taken"),
    [
        ("distributed_mass", 120.0, "distributed_mass"),
        ("distributed_mass", 90.0, "tip_payload"),
        ("tip_payload", 120.0, "tip_payload"),
    ],
)
def test_an_effect_is_chosen_again_beside_the_one_that_was_found_after_it(
    monkeypatch, better, worth, taken, *, rival: bool
):
    """A payload that stood for a part of a gain too gives way to what explains more beside the gain.

    That may have been no rival before: it is looked for where the size of the payload has moved.
    """
    payload = candidate(fit_of("tip_payload", 0.03, deviation=0.002), 110.0, 0)
    now = payload.fit if rival else fit_of("tip_payload", 0.027, deviation=0.002)
    mass = candidate(fit_of("distributed_mass", 0.1), 100.0, 1)
    later = candidate(fit_of("chamber_gain", 0.1), 60.0, 2)
    field = (payload, mass) if rival else (payload,)
    first, second = Accepted(payload, judgement(), field), Accepted(later, judgement(), (later,))

    def screened(evidence, marginal, taken):
        assert not rival
        assert taken == {2, 7}
        return [(0, 50.0, payload.fit.thetas[0]), (1, 40.0, mass.fit.thetas[0]), (3, 5.0, np.zeros(1))]

    def best(field, left, null, others):
        assert [one.number for one in field] == [0, 1]
        assert [h.name for h in left.hypotheses] == ["chamber_gain"]
        assert others == [second]
        likeliest = next(one for one in field if one.fit.hypotheses[0].name == better)
        return Accepted(likeliest, judgement(), tuple(field)), None

    search = SimpleNamespace(
        refit=lambda fit: fit,
        finalists=lambda _, left, ranked: [{0: payload, 1: mass}[number] for number, *_ in ranked],
        best=best,
        worth=lambda fit: worth if fit.hypotheses[0].name == "distributed_mass" else 100.0,
        evidence=None,
        left_free=lambda _: SimpleNamespace(problem=lambda: None, marginal=None),
        at_size=lambda ranked, _: ranked,
    )
    monkeypatch.setattr("softarm.estimator.diagnosis.choose.screen", screened)
    accepted, fit = Search.reconsidered(
        cast("Any", search), [first, second], now.joined(later.fit), np.zeros(1), frozenset({7})
    )
    names = [taken, "chamber_gain"]
    assert [one.candidate.fit.hypotheses[0].name for one in accepted] == names
    assert fit is not None
    assert [h.name for h in fit.hypotheses] == names
    assert [theta.tolist() for theta in fit.thetas] == [
        [0.1] if taken == "distributed_mass" else now.thetas[0].tolist(),
        [0.1],
    ]


@pytest.mark.parametrize(("share", "moved"), [(0.9, False), (1.1, True), (-1.1, True)])
def test_an_effect_has_moved_by_more_than_its_deviation(share, moved):
    then = fit_of("tip_payload", 0.03, deviation=0.002)
    later = fit_of("chamber_gain", 0.1)
    now = later.joined(fit_of("tip_payload", 0.03 + share * 0.002))
    assert is_moved(now, 1, then) is moved


def confirming(*left: float) -> list[NormalEquations]:
    """Stretches that confirm, with residuals of these sizes in turn."""
    found = []
    for number in range(8):
        rng = np.random.default_rng([11, number])
        residual = left[number % len(left)] + rng.normal(size=(SAMPLES, 1))
        held = np.ones(SAMPLES, dtype=bool)
        blocks, none = np.zeros(SAMPLES, dtype=int), np.zeros(SAMPLES, dtype=bool)
        columns = rng.normal(size=(SAMPLES, 1, 1))
        found += normal_equations(residual, columns, np.ones(1), blocks, held, none, number, nominal=False)
    return found


MOSTLY_WORSE = ((2.0, *[0.0] * 7), (0.0, *[0.4] * 7))
"""Residuals without and with an effect that shows in one stretch of eight."""
ONCE_BETTER = ((3.0, *[0.0] * 7), (0.0, *[0.4] * 7))
"""The same where that one alone gains as much as the effect's size says, but for chance."""


@pytest.mark.parametrize(
    ("before", "after", "shown", "lost"),
    [
        ((1.0,), (0.0,), 1.0, []),
        ((1.0,), (1.0,), 1.0, [0]),
        ((1.0,), (1.0,), 0.0, []),
        (*MOSTLY_WORSE, 0.5, []),
        (*MOSTLY_WORSE, 1.0, [0]),
        (*ONCE_BETTER, 1.0, []),
    ],
)
def test_an_effect_has_to_predict_the_confirming_stretches_if_it_would_show_there(before, after, shown, lost):
    """All together as well as its size says, or any that are drawn better than without it."""
    fit = fit_of("tip_payload", 0.02)

    def products(weights, more, parts, left):
        change = np.full((SAMPLES, 1, 1), shown)
        none = np.zeros(SAMPLES, dtype=int)
        common, left = np.zeros((SAMPLES, 1, 1)), np.zeros((SAMPLES, 1))
        return [new for own in parts for new in with_columns([own], left, common, change, np.ones(1), none)]

    search = SimpleNamespace(
        left=lambda own: SimpleNamespace(parts=confirming(*(before if own is None else after)), residuals=[]),
        prior=Gaussian(np.zeros(1), 1e-4 * np.eye(1)),
        weights=SimpleNamespace(effective_sample_fraction=1.0),
        evidence=SimpleNamespace(size=1, with_columns=products),
        rng=np.random.default_rng(0),
        subset=lambda _, kept: None if not kept else fit,
    )
    assert unproven(cast("Any", search), chosen(fit)) == lost
    if lost:  # of several that fail together the weakest
        search.contribution = lambda _, number: [90.0, 40.0][number]
        assert unproven(cast("Any", search), chosen(fit, fit_of("chamber_gain", 0.1))) == [1]


def test_two_recordings_are_judged_by_spans_of_time():
    """Each span is predicted from the others: a size that only one span shows is no effect."""

    def spans(sizes: list[float]) -> list[NormalEquations]:
        parts = recordings(sizes)
        return [replace(part, session=number // 3, block=number) for number, part in enumerate(parts)]

    steady, once = (judged_on(spans(sizes)) for sizes in ([2.0] * 5, [2.0, 0.0, 0.0, 0.0, 0.0]))
    assert steady.accepted
    assert not once.accepted


def test_a_candidate_that_changes_nothing_is_not_accepted():
    parts = recordings([0.0] * RUNS)
    for part in parts:
        part.matrix[-1], part.matrix[:, -1], part.vector[-1] = 0.0, 0.0, 0.0
    found = judged_on(parts)
    assert found.after == pytest.approx(found.before)
    assert not found.accepted


def test_a_law_includes_a_plainer_one_that_is_part_of_it():
    """A leak may be behind a narrow line: then that line is late, whichever law is chosen."""

    def fitted(name: str, chamber: int, *theta: float) -> Fit:
        return replace(fit_of(name, *theta), hypotheses=(hypothesis(name, Place(chamber=chamber)),))

    late, leak = fitted("line_lag", 1, 0.2), fitted("line_leak", 1, 0.1, 0.2, 1.0)
    assert includes(leak, late)
    assert not includes(leak, fitted("line_lag", 1, -0.2))
    assert not includes(late, leak)
    assert not includes(fitted("line_leak", 2, 0.1, 0.2, 1.0), late)
    assert not includes(fitted("line_leak", 1, 0.1, 0.9 * SIGNIFICANT_Z * 1e-3, 1.0), late)


def test_a_law_that_says_no_more_than_a_plainer_one_restates_it():
    """A leak that loses nothing is a late line."""
    place = Place(chamber=1)

    def leak(share: float) -> Fit:
        return replace(fit_of("line_leak", share, 0.2, 1.0), hypotheses=(hypothesis("line_leak", place),))

    late = replace(fit_of("line_lag", 0.2), hypotheses=(hypothesis("line_lag", place),))
    elsewhere = replace(fit_of("line_lag", 0.2), hypotheses=(hypothesis("line_lag", Place(chamber=2)),))
    assert restates(leak(0.9 * SIGNIFICANT_Z * 1e-3), late)
    assert not restates(leak(1.1 * SIGNIFICANT_Z * 1e-3), late)
    assert not restates(leak(0.0), elsewhere)
    assert not restates(late, leak(0.0))


def test_stretches_in_which_an_effect_hardly_shows_may_by_chance_gain_less_than_nothing():
    """The gain of an effect that acts is normal with mean g and deviation 2 sqrt(g)."""
    expected = np.array([60.0, 5.0, 1.0])
    assert lost_by_chance(expected, [0, 1, 2]) == 0.0
    assert lost_by_chance(expected, [2]) == pytest.approx(3.0)
    assert lost_by_chance(expected, [1, 2, 2]) == pytest.approx(4.0 * 9.0**0.5 - 7.0)
    gains = expected + 2.0 * np.sqrt(expected) * np.random.default_rng(5).normal(size=(20000, 3))
    for number in (1, 2):
        assert (gains[:, number] + lost_by_chance(expected, [number]) < 0.0).mean() < 0.03


def test_something_present_does_not_pull_where_it_can_only_push():
    wall = Library(
        (hypothesis("contact_obstacle"),), (Direction(0, 0, -1, np.array([30.0, 0.01, 0.0]), 1.0, 1.0),)
    )
    evidence = cast("Any", SimpleNamespace(nuisances=0, library=wall))
    scores = []
    for sign in (1.0, -1.0):
        marginal = Marginal(
            np.array([[100.0]]), np.array([sign * 80.0]), 500.0, 400.0, np.zeros(1), np.eye(1)
        )
        ((_, score, theta),) = screen(evidence, marginal, frozenset())
        assert theta == pytest.approx([30.0, 0.01, 0.0])
        scores.append(score)
    assert scores[0] > 0.0 > scores[1]


def test_halves_of_a_single_nominal_recording_show_what_changes_by_itself():
    def width(change: float) -> float:
        arm = ArmOfOneEffect(change)
        halves = [(number, part) for number, part in enumerate(arm.parts) if number in (1, 4)]
        arm.parts = [replace(part, session=0, block=number, nominal=True) for number, part in halves]
        weights = cast("Any", SimpleNamespace(effective_sample_fraction=1.0))
        return prior_before(cast("Any", arm), weights, frozenset())[1]

    assert width(0.0) < MATERIAL < width(0.5)


@pytest.mark.parametrize(
    ("instead", "stands", "dropped"),
    [
        (120.0, ["distributed_mass"], ["tip_payload"]),
        (80.0, [], ["tip_payload", "distributed_mass"]),
        (None, [], ["tip_payload"]),
    ],
)
def test_what_takes_the_place_of_a_choice_that_failed_has_to_explain_more(
    monkeypatch, instead, stands, dropped
):
    def choice(name: str, number: int) -> ChosenEffects:
        one = candidate(fit_of(name, 0.02), 100.0, number)
        return ChosenEffects((Accepted(one, judgement(), ()),), one.fit, 0.0, None)

    def names(accepted: Sequence[Accepted]) -> list[str]:
        return [one.candidate.fit.hypotheses[0].name for one in accepted]

    failing, holding = choice("tip_payload", 0), choice("distributed_mass", 1)
    found = [failing, holding] if instead is not None else [failing]
    search = SimpleNamespace(
        run=lambda without: found[len(without)] if len(without) < len(found) else chosen(),
        without=lambda choice, lost: chosen() if lost else choice,
    )
    gains = {"tip_payload": 100.0, "distributed_mass": instead}
    monkeypatch.setattr(confirm, "unproven", lambda _, choice, __: [0] if choice is failing else [])
    monkeypatch.setattr(
        confirm, "gain_of_all", lambda _, choice: sum(gains[name] for name in names(choice.accepted))
    )
    held, lost = confirm.proven(cast("Any", search))
    assert names(held.accepted) == stands
    assert names(lost) == dropped


def test_without_confirming_stretches_nothing_is_unproven():
    search = cast(
        "Any", SimpleNamespace(left=lambda _: SimpleNamespace(parts=[]), rng=np.random.default_rng(0))
    )
    assert unproven(search, chosen(fit_of("tip_payload", 0.02))) == []


@pytest.mark.parametrize(("probability", "changed"), [(0.99, True), (0.5, False)])
def test_a_law_alone_shows_that_something_is_missing_if_it_is_probable(monkeypatch, *, probability, changed):
    law = UnnamedLaw(2.0 * CERTAIN, 0.0, 1.0, (), Place(), "pressure level")
    decision = decide_on(monkeypatch, chosen(), unnamed_law=law, unnamed_probability=probability)
    assert decision.changed is changed
    assert decision.law == (replace(law, probability=probability) if changed else None)


@pytest.mark.parametrize(("probability", "stays"), [(0.4, True), (0.8, False)])
def test_names_that_are_less_likely_than_a_slight_law_are_withdrawn(monkeypatch, probability, *, stays: bool):
    """Of two explanations that both are hardly more than nothing, neither is stated."""
    slight = UnnamedLaw(0.5 * CERTAIN, 0.4 * CERTAIN, probability, (hypothesis("tip_payload"),), Place(), "")
    payload = chosen(fit_of("tip_payload", 0.002), gain=12.0)
    made = {"without_fragments": (payload, payload.fit, []), "unnamed_law": slight}
    decision = decide_on(monkeypatch, payload, **made)
    assert decision.law is None
    assert (decision.choice.fit is not None) is stays
    assert decision.dropped == (() if stays else ("tip_payload",))
    assert decision.verdict(explained=stays) == ("explained" if stays else "consistent")


@pytest.mark.parametrize(
    ("rivals", "fits_worse_by", "several", "stays"),
    [
        (("line_lag", "fibre_twist"), 0.0, True, False),
        (("line_lag", "fibre_twist"), 0.0, False, True),
        (("line_lag",), 4.0, True, True),
        (("line_lag",), 40.0, True, True),
        (("line_leak",), 0.0, True, True),
    ],
)
def test_of_several_effects_one_that_is_no_likelier_than_a_rival_is_withdrawn(
    monkeypatch, rivals, fits_worse_by, *, several, stays
):
    """A leak that ends at once is a lost gain under another name: it is no reason to withdraw the gain."""
    place = Place(chamber=0)
    gain = replace(fit_of("chamber_gain", 0.1), hypotheses=(hypothesis("chamber_gain", place),))
    field = [candidate(gain, 100.0, 0)]
    for number, rival in enumerate(rivals, start=1):
        theta = EFFECTS[rival].typical
        other = Fit((hypothesis(rival, place),), (theta,), np.eye(len(theta)), gain.gain)
        field.append(candidate(other, 100.0, number))
    payload = candidate(fit_of("tip_payload", 0.02), 1000.0, len(field))
    chosen_effects = [Accepted(field[0], judgement(), tuple(field))]
    if several:
        chosen_effects.append(Accepted(payload, judgement(), (payload,)))
    fit = gain.joined(payload.fit) if several else gain

    def without(choice, dropped):
        kept = [k for k in range(len(choice.accepted)) if k not in dropped]
        return replace(
            choice, accepted=tuple(choice.accepted[k] for k in kept), fit=choice.fit.selected(kept)
        )

    gains = [200.0, *(200.0 - fits_worse_by for _ in rivals), 1000.0]
    search = weighing((*field, payload), gains)
    search.without = without
    monkeypatch.setattr(explanations, "without_fragments", lambda _, choice: (choice, choice.fit, []))
    choice = ChosenEffects(tuple(chosen_effects), fit, 0.0, None)
    kept, sizes, dropped = without_improbable(search, choice, fit)
    assert dropped == ([] if stays else ["chamber_gain"])
    assert kept.accepted == (choice.accepted if stays else choice.accepted[1:])
    assert sizes is kept.fit


def gain_or_lag_beside_a_payload() -> tuple[ChosenEffects, tuple[Candidate, Candidate], Candidate]:
    """Accept a gain of chamber 0, whose rival is a lag there, and a payload."""
    place = Place(chamber=0)
    gain = replace(fit_of("chamber_gain", 0.1), hypotheses=(hypothesis("chamber_gain", place),))
    lag = Fit((hypothesis("line_lag", place),), (np.array([0.3]),), np.eye(1), gain.gain)
    payload = candidate(fit_of("tip_payload", 0.02), 1000.0, 2)
    field = (candidate(gain, 100.0, 0), candidate(lag, 100.0, 1))
    accepted = (Accepted(field[0], judgement(), field), Accepted(payload, judgement(), (payload,)))
    choice = ChosenEffects(accepted, gain.joined(payload.fit), 0.0, None)
    return choice, field, payload


@pytest.mark.parametrize(("refused", "name"), [((), "line_lag"), ((1,), "tip_payload")])
def test_a_rival_that_is_likelier_than_not_takes_the_place_of_one_of_several(monkeypatch, refused, name):
    """It was chosen beside one that was taken back since; not so if confirming data disprove the rival."""
    choice, field, payload = gain_or_lag_beside_a_payload()

    def exchanged(choice, number, one):
        assert number == 0
        own = replace(choice.accepted[0], candidate=one)
        return replace(choice, accepted=(own, choice.accepted[1]), fit=one.fit.joined(payload.fit))

    search = weighing((*field, payload), [200.0, 230.0, 1000.0])
    search.exchanged = exchanged
    search.without = lambda choice, _: replace(choice, accepted=choice.accepted[1:], fit=payload.fit)
    monkeypatch.setattr(explanations, "without_fragments", lambda _, choice: (choice, choice.fit, []))
    kept, _, dropped = without_improbable(search, choice, choice.fit, frozenset(refused))
    assert kept.accepted[0].candidate.fit.hypotheses[0].name == name
    assert dropped == (["chamber_gain"] if refused else [])


def test_a_rival_that_is_less_likely_once_it_is_fitted_takes_no_place(monkeypatch):
    """Beside the fit of either one the other may seem likelier."""
    choice, field, payload = gain_or_lag_beside_a_payload()

    def of(_: object, chosen: ChosenEffects, index: int) -> SimpleNamespace:
        name = chosen.fit.hypotheses[index].name
        likely = {"chamber_gain": 0.45, "line_lag": 0.2, "tip_payload": 1.0}[name]
        return SimpleNamespace(or_alike=likely, each={("line_lag", Place(chamber=0)): 0.55})

    search = weighing((*field, payload), [200.0, 230.0, 1000.0])
    search.exchanged = lambda chosen, *_: replace(chosen, fit=field[1].fit.joined(payload.fit))
    monkeypatch.setattr(explanations.Explanations, "of", of)
    kept, _, dropped = without_improbable(search, choice, choice.fit)
    assert kept is choice
    assert dropped == []


def weighing(field: Sequence[Candidate], gains: Sequence[float]) -> Any:
    """Return a search in which candidates explain so much beside the price of their parameters."""
    none, price = np.full(5, 400.0), 5.0

    def predicted(one: Candidate, _: Fit | None) -> FoldCosts:
        explained = gains[one.number] + price * (one.degrees_of_freedom - 1)
        return FoldCosts(none, none, none, none, np.full(5, explained / 5.0), 0.0 * none)

    return SimpleNamespace(
        rng=np.random.default_rng(0),
        bic_penalty=price,
        evidence=SimpleNamespace(
            library=Library(tuple(one.fit.hypotheses[0] for one in field), ()),
            stages=(SimpleNamespace(world=SimpleNamespace(pressure_limits=(5e4,))),),
        ),
        predicted=predicted,
        subset=lambda fit, kept: fit.selected(kept) if kept else None,
    )


@pytest.mark.parametrize(
    ("gains", "unnamed", "several"),
    [
        ([200.0, 200.0, 200.0], 0.0, True),
        ([200.0, 200.0, 100.0], 0.0, False),
        ([260.0, 200.0, 200.0], 0.0, False),
        ([204.0, 200.0, 200.0], 0.0, False),
        ([204.0, 200.0, 200.0], 0.6, True),
    ],
)
def test_of_many_effects_none_is_named_that_is_not_likelier_than_not(gains, unnamed, several):
    """Two that the recordings fit equally well are a finding and its rival."""
    names = ("tip_payload", "base_tilt", "chamber_crosstalk")
    field = [
        candidate(fit_of(name, *(p.typical for p in EFFECTS[name].parameters), gain=gain), gain, number)
        for number, (name, gain) in enumerate(zip(names, gains, strict=True))
    ]
    choice = ChosenEffects((Accepted(field[0], judgement(), tuple(field)),), field[0].fit, 0.0, None)
    found = undecided(weighing(field, gains), choice, unnamed)
    assert [one.effect for one in found] == (list(names) if several else [])
    if several:
        finding = unknown(
            Unexplained(4.0), Heldout(4.0, 4.0, (0.0, 0.0), ""), 0.0, None, unnamed, one_of=found
        )
        assert finding.confusable_with == found
        assert "3 known effects" in finding.statement

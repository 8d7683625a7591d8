"""The search accepts one effect at a time, on numbers of which it is known what they should decide."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis import choose, sizes
from softarm.estimator.diagnosis.candidates import (
    Accepted,
)
from softarm.estimator.diagnosis.choose import DELAY_SHARE, FINALISTS, SECOND, Search
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.judge import (
    FoldCosts,
)
from softarm.estimator.diagnosis.library import Hypothesis, Library
from softarm.estimator.diagnosis.sizes import fragments
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import TIP, candidate, fit_of, hypothesis, judgement


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

"""The verdict follows from what was found and what is left."""

from dataclasses import replace
from typing import Any, cast

import pytest

from softarm.estimator.diagnosis import diagnose
from softarm.estimator.diagnosis.candidates import (
    ChosenEffects,
)
from softarm.estimator.diagnosis.conclude import unknown
from softarm.estimator.diagnosis.diagnose import Decision
from softarm.estimator.diagnosis.judge import (
    CERTAIN,
)
from softarm.estimator.diagnosis.result import Heldout, Rival, Unexplained
from softarm.estimator.diagnosis.unnamed import UnnamedLaw
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import TIP, candidate, chosen, fit_of, hypothesis, judgement


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

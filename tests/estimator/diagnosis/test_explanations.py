"""No name is stated that is no likelier than its rivals."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softarm.estimator.diagnosis import explanations
from softarm.estimator.diagnosis.candidates import (
    Accepted,
    Candidate,
    ChosenEffects,
)
from softarm.estimator.diagnosis.conclude import unknown
from softarm.estimator.diagnosis.explanations import undecided, without_improbable
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.judge import (
    FoldCosts,
)
from softarm.estimator.diagnosis.library import Library
from softarm.estimator.diagnosis.result import Heldout, Unexplained
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import (
    candidate,
    fit_of,
    hypothesis,
    judgement,
)


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

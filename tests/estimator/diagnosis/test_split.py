"""What is held out: never what is nominal, always something, and what the others excite as well."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.split import excitation, hold_out
from softarm.estimator.diagnosis.words import EXCITATION, manoeuvre
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen import load_specimen
from tests.estimator.diagnosis.linear_arm import session

LIMITS = np.array(load_specimen("sopra").pressure_limits)


@pytest.fixture(scope="module")
def sessions() -> list[Session]:
    return [session("known", 0, nominal=True), *(session(f"run_{k}", k) for k in range(1, 7))]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_something_is_held_out_and_most_is_not(sessions: list[Session], count: int) -> None:
    split, how = hold_out(sessions[: count + 1], LIMITS)
    assert not split[0].heldout.any()
    held = np.concatenate([one.heldout for one in split[1:]])
    assert 0.1 < held.mean() < 0.45
    assert ("whole recording" in how) == (count >= 4)
    assert any(not one.heldout.all() for one in split[1:])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_what_confirms_is_not_what_is_reported_and_both_are_there(
    sessions: list[Session], count: int
) -> None:
    split, how = hold_out(sessions[: count + 1], LIMITS)
    reported = np.concatenate([one.reported for one in split])
    confirming = np.concatenate([one.heldout for one in split]) & ~reported
    assert reported.mean() > 0.03
    assert "none confirmed" not in how
    assert confirming.any()
    assert all(
        one.reported[one.blocks == b].all() or not one.reported[one.blocks == b].any()
        for one in split
        for b in np.unique(one.blocks)
    )


def test_the_one_stretch_that_is_left_of_a_recording_is_reported(sessions: list[Session]) -> None:
    cut = sessions[1].thin(sessions[1].blocks < 6)
    (split,), how = hold_out([cut], LIMITS)
    assert "none confirmed" in how
    assert split.reported.any()
    assert split.heldout.tolist() == split.reported.tolist()


def test_of_those_held_out_the_one_that_drives_most_chambers_is_reported(sessions: list[Session]) -> None:
    """An effect on a chamber that is vented throughout would show nothing in what is reported."""
    runs = [session(f"run_{k}", k) for k in range(1, 13)]
    whole = [one for one in hold_out(runs, LIMITS)[0] if one.heldout.all()]
    assert len(whole) == 2
    assert [one.name for one in whole if one.reported.all()] == [whole[-1].name]
    vented = whole[-1].pressures * [1.0, 1.0, 0.0, 1.0, 1.0, 1.0]
    runs = [replace(one, pressures=vented) if one.name == whole[-1].name else one for one in runs]
    split, how = hold_out(runs, LIMITS)
    assert [one.name for one in split if one.reported.all()] == [whole[0].name]
    assert whole[0].name in how


def test_the_only_recording_of_a_kind_is_not_held_out(sessions: list[Session]) -> None:
    sideways, down = (
        np.broadcast_to(g, sessions[2].gravity.shape) for g in ([9.81, 0.0, 0.0], [0.0, 0.0, 9.81])
    )
    alone = replace(sessions[2], gravity=sideways)
    hanging = [replace(one, gravity=down[: one.samples]) for one in sessions]
    runs = [*hanging[:2], alone, *hanging[3:]]
    assert "mount_turned" in excitation(runs, LIMITS)
    split, _ = hold_out(runs, LIMITS)
    assert not split[2].heldout.all()


def test_every_effect_and_every_pair_has_its_words() -> None:
    assert len(EFFECTS) == 30
    for name, effect in EFFECTS.items():
        assert effect.name == name
        assert effect.when.strip(), name
        shape = sum(parameter.role == "shape" for parameter in effect.parameters)
        assert not effect.by_fit or all(len(values) == shape for values in effect.shapes), name
    assert {need for effect in EFFECTS.values() for need in effect.needs} <= set(EXCITATION)
    assert all(manoeuvre(one, other) for one in EFFECTS for other in EFFECTS if one != other)


def test_a_session_that_was_never_split_reports_what_is_held_out_however_it_is_thinned() -> None:
    one = replace(session("run", 1), heldout=np.arange(len(session("run", 1).clock)) % 2 == 0)
    thin = one.thin(np.arange(one.samples) < 20)
    shorter = replace(thin, heldout=thin.heldout[:7])
    assert thin.reported.tolist() == thin.heldout.tolist()
    assert shorter.reported.tolist() == shorter.heldout.tolist()


def test_thinning_keeps_what_confirms_with_its_samples(sessions: list[Session]) -> None:
    split, _ = hold_out(sessions[:4], LIMITS)
    chosen = next(one for one in split if (one.heldout & ~one.reported).any())
    assert chosen.thin(chosen.heldout).reported.tolist() == chosen.reported[chosen.heldout].tolist()

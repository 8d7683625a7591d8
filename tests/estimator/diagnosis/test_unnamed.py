"""Laws without a name: only what has changed since the nominal recordings counts."""

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis import unnamed
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.diagnose import assemble, begin
from softarm.estimator.diagnosis.judge import (
    CERTAIN,
)
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.unnamed import UnnamedLaw, unnamed_law
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import EffectName, Place
from tests.estimator.diagnosis.linear_arm import LOCKING, Concealed, model, session
from tests.estimator.diagnosis.made import (
    hypothesis,
)

LAW = ((LOCKING, Place(segment="lower"), (0.05, 0.5)),)
"""Half of what the lower segment bends beyond 0.05 rad is lost."""
FAINT = ((LOCKING, Place(segment="lower"), (0.05, 0.02)),)
"""One fiftieth of it."""
GAIN = (("chamber_gain", Place(chamber=1), (-0.15,)),)


def searching(nominal: Concealed, questioned: Concealed, name: EffectName = "chamber_gain") -> Search:
    """Search for an effect in four recordings beside two nominal ones, with what acts in either."""
    sessions = [session(f"nominal_{k}", k, nominal, nominal=True) for k in range(2)]
    sessions += [session(f"run_{k}", 10 + k, questioned) for k in range(4)]
    return begin(assemble(model(), sessions, Inline(), (name,)).evidence, fast=False)


@pytest.mark.parametrize(("nominal", "changed"), [((), True), (LAW, False)])
def test_a_law_that_nominal_recordings_show_too_is_no_change(nominal: Concealed, *, changed: bool):
    assert (unnamed_law(searching(nominal, LAW), None).gain > CERTAIN) is changed


@pytest.mark.parametrize(
    ("questioned", "unknown"),
    [(LAW, True), ((*LAW, *GAIN), True), ((*FAINT, *GAIN), False), (GAIN, False)],
)
def test_what_explains_more_alone_is_what_acts(questioned: Concealed, *, unknown: bool):
    """Beside the other each of the two explains more, whichever is in the recordings."""
    search = searching((), questioned)
    own = [h.place for h in search.evidence.library.hypotheses].index(Place(chamber=1))
    gain = search.candidate(own, np.array([-0.1]), search.problem(), None)
    assert gain is not None
    assert (unnamed_law(search, gain.fit).probability > 0.5) is unknown


@pytest.mark.parametrize("size", [-0.3, -0.2, -0.1, 0.1, 0.3])
def test_a_law_that_states_what_a_name_does_takes_its_place_nowhere(size: float):
    """The first hinge of a segment's bend is its stiffness."""
    lower = Place(segment="lower")
    search = searching((), (("segment_stiffness", lower, (size,)),), "segment_stiffness")
    own = [h.place for h in search.evidence.library.hypotheses].index(lower)
    stiffness = search.candidate(own, np.array([size]), search.problem(), None)
    assert stiffness is not None
    assert unnamed_law(search, stiffness.fit).probability < 0.05


STIFFENING = (("material_stiffening", Place(segment="lower"), (0.3,)),)


@pytest.mark.parametrize(
    ("name", "concealed", "unknown"),
    [
        ("material_stiffening", STIFFENING, False),
        ("material_stiffening", LAW, False),
        ("material_softening", LAW, True),
    ],
)
def test_a_free_form_of_what_a_name_states_must_gain_much_more(
    monkeypatch: pytest.MonkeyPatch, name: EffectName, concealed: Concealed, *, unknown: bool
):
    """The hinges of a bend follow any law of it, also what the form of a right one gets wrong of the arm.

    What locks stiffens, and softens nowhere. A passive beam has no laws but those of its bends.
    """
    lower = Place(segment="lower")
    search = searching((), concealed, name)
    own = [h.place for h in search.evidence.library.hypotheses].index(lower)
    typical = np.array(search.evidence.library.hypotheses[own].effect.typical)
    material = search.candidate(own, typical, search.problem(), None)
    assert material is not None
    every = unnamed.laws(search, smooth=True)
    for listed in (every, [law for law in every if unnamed.is_freer_form(law, material.fit)]):
        monkeypatch.setattr(unnamed, "laws", lambda *_, listed=listed, **__: listed)
        assert unnamed_law(search, material.fit).outdoes is unknown


def test_the_names_that_a_law_outdoes_are_listed_once() -> None:
    names: tuple[EffectName, ...] = ("sensor_drift", "sensor_drift", "line_lag")
    nearest = tuple(Hypothesis(EFFECTS[name], Place()) for name in names)
    law = UnnamedLaw(100.0, 10.0, 0.99, nearest, Place(), "")
    assert law.sentence().endswith("predicts unseen recordings better than sensor drift, line lag.")


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

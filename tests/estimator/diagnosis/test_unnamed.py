"""Laws without a name: only what has changed since the nominal recordings counts."""

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis import unnamed
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.diagnose import assemble, begin
from softarm.estimator.diagnosis.judge import CERTAIN
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.unnamed import UnnamedLaw, unnamed_law
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import EffectName, Place
from tests.estimator.diagnosis.linear_arm import LOCKING, Concealed, model, session

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


def test_where_every_law_is_stated_none_competes(monkeypatch: pytest.MonkeyPatch):
    """A passive beam has laws of its bend alone, which an accepted law of bend states."""
    name, lower = "material_softening", Place(segment="lower")
    search = searching((), LAW, name)
    own = [h.place for h in search.evidence.library.hypotheses].index(lower)
    effect = search.evidence.library.hypotheses[own].effect
    softening = search.candidate(
        own, np.array([p.typical for p in effect.parameters]), search.problem(), None
    )
    assert softening is not None
    of_bend = [law for law in unnamed.laws(search, smooth=False) if law.regime == unnamed.BEND]
    monkeypatch.setattr(unnamed, "laws", lambda *_, **__: [law for law in of_bend if law.place == lower])
    law = unnamed_law(search, softening.fit)
    assert (law.probability, law.outdoes) == (0.0, False)


def test_the_names_that_a_law_outdoes_are_listed_once() -> None:
    names: tuple[EffectName, ...] = ("sensor_drift", "sensor_drift", "line_lag")
    nearest = tuple(Hypothesis(EFFECTS[name], Place()) for name in names)
    law = UnnamedLaw(100.0, 10.0, 0.99, nearest, Place(), "")
    assert law.sentence().endswith("predicts unseen recordings better than sensor drift, line lag.")

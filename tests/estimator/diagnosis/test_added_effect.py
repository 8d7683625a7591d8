"""An effect is one object: a diagnosis finds, places and words one that was added beside the library's."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from softarm.estimator.diagnosis.conclude import exposing_variable
from softarm.estimator.diagnosis.diagnose import diagnose
from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, trial
from tests.estimator.effects.added_effect import EFFECT


def test_an_effect_that_was_added_is_found_placed_and_worded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EFFECTS, EFFECT.name, EFFECT)
    sessions = trial([(EFFECT, Place(chamber=4), (0.25,))])
    with ThreadPoolExecutor(1) as executor:
        tried = [EFFECT.name, "tip_payload", "segment_stiffness"]
        found = diagnose(model(), sessions, executor, effects=tried).diagnosis
    (finding,) = found.findings
    assert (finding.effect, finding.where.chamber) == ("chamber_growth", 4)
    assert finding.parameters["growth"].value == pytest.approx(0.25, abs=0.05)
    assert finding.when == "pressure level"
    assert "varies with the pressure level" in finding.statement
    stage = calibrate_sessions(model(), sessions).stage(model(), sessions[0])
    name, unit, values = exposing_variable(stage, EFFECT.name, Place(chamber=4))
    assert (name, unit) == ("pressure of chamber 4", "Pa")
    np.testing.assert_array_equal(values, stage.session.pressures[:, 4])

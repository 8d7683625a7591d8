"""Findings say what they are."""

import pytest

from softarm.estimator.diagnosis.conclude import unknown
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.result import Heldout, Unexplained
from softarm.estimator.diagnosis.unnamed import UnnamedLaw
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place


@pytest.mark.parametrize(("probability", "rival"), [(0.6, True), (0.99, False)])
def test_the_effects_that_a_law_hardly_outdoes_are_its_rivals(*, probability: float, rival: bool) -> None:
    scale = Hypothesis(EFFECTS["sensor_scale"], Place(sensor="bend_tip"))
    law = UnnamedLaw(40.0, 36.0, probability, (scale,), Place(segment="lower"), "pose")
    finding = unknown(Unexplained(4.0), Heldout(4.0, 4.0, (0.0, 0.0), ""), 0.0, law, probability)
    assert finding.probability == probability
    rivals = [(one.effect, one.where, one.log_bayes_factor) for one in finding.confusable_with]
    assert rivals == ([("sensor_scale", Place(sensor="bend_tip"), 2.0)] if rival else [])

"""What the intake of recordings adds to a diagnosis."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.analysis.diagnosis.intake import with_intakes
from softarm.estimator.intake import Disturbance, Intake
from softarm.estimator.recording import Recording
from tests.service.diagnosis.made_diagnosis import diagnosis

EVENT = Disturbance("run_03", (12.0, 16.0), ("bend_tip",), 0.1, 0.03, 0.01, 0.002, 0.99)
INTAKE = Intake(Recording("run_03", np.arange(5.0), {}), events=(EVENT,))


@pytest.mark.parametrize(
    ("nominal", "verdict", "reported"),
    [
        (("nominal_00",), "explained", True),
        (("nominal_00",), "consistent", True),
        (("nominal_00",), "unexplained", False),
        ((), "unexplained", True),
    ],
)
def test_beside_a_law_without_a_name_nobody_can_say_what_is_an_event(nominal, verdict, reported):
    found = with_intakes(replace(diagnosis(), nominal=nominal, verdict=verdict, findings=()), [INTAKE], ())
    assert [one.effect for one in found.findings] == (["event"] if reported else [])
    assert any(EVENT.statement in note for note in found.notes) != reported

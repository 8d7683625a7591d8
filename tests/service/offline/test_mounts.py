"""A recording says how the arm was mounted."""

import numpy as np
import pytest

from softarm.analysis.offline.inputs import in_its_mount
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen


def recording(**info: object) -> Recording:
    return Recording("run", np.zeros(1), {}, info)


def test_gravity_is_that_of_the_recording_where_it_has_one():
    sopra = load_specimen("sopra")
    assert in_its_mount(sopra, recording()) is sopra
    turned = in_its_mount(sopra, recording(gravity_m_s2=[9.81, 0, 0.0]))
    assert turned.gravity_m_s2 == (9.81, 0.0, 0.0)
    assert turned.segments == sopra.segments


@pytest.mark.parametrize("given", [[1.0, 2.0], "down", [0.0, 0.0, float("nan")], [None, 0, 0]])
def test_what_is_no_gravity_is_refused(given: object):
    with pytest.raises(InputError, match="gravity_m_s2"):
        in_its_mount(load_specimen("sopra"), recording(gravity_m_s2=given))

"""The directions in which chambers bend an arm."""

import numpy as np

from softarm.estimator.intake.bending import bending_directions
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen


def test_a_beam_without_chambers_bends_in_no_direction_of_theirs() -> None:
    time = 0.1 * np.arange(50)
    still = Recording("beam", time, {"marker_tip0_x_m": np.zeros(50)})
    assert bending_directions(still, load_specimen("beam"), ()) is None

"""What tests of the diagnosis share."""

import numpy as np
import pytest

from softarm.estimator.diagnosis.library import Direction, Library
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import TIP, hypothesis


@pytest.fixture
def library() -> Library:
    directions = (
        Direction(0, 0, 0, np.array([0.01]), 0.01, 0.02),
        Direction(1, 0, 0, np.array([2.5, 0.01, 0.0]), 2.5, 5.0),
        Direction(2, 0, 0, np.array([0.04]), 0.04, 0.08),
    )
    places = (TIP, TIP, Place(chamber=1))
    names = ("tip_payload", "tether_stiffness", "chamber_gain")
    return Library(tuple(map(hypothesis, names, places)), directions)

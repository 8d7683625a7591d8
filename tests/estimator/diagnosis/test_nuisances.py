"""What a calibration before any effect reports of its result."""

from dataclasses import replace

import numpy as np

from softarm.estimator.calibration.unknowns import Modulus
from softarm.estimator.diagnosis.nuisances import BEYOND, Nuisances, layout_of
from softarm.estimator.specimen import load_specimen
from tests.estimator.diagnosis.linear_arm import model, session

SOPRA = load_specimen("sopra")


def test_a_value_that_leaves_its_prior_is_reported_with_its_size():
    layout = layout_of(model(SOPRA), [session("run", 1)])
    found = Nuisances(layout, layout.means.copy())
    assert found.beyond_prior == ()
    place = int(np.flatnonzero(layout.of(Modulus))[0])
    values = layout.means.copy()
    values[place] += 1.1 * BEYOND * layout.spreads[place]
    (sentence,) = replace(found, values=values).beyond_prior
    assert layout.names[place] in sentence
    assert "times what the specimen says, 3.3 standard deviations off" in sentence

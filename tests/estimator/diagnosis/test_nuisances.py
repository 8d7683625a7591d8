"""What a calibration before any effect reports of its result."""

from dataclasses import replace

import numpy as np

from softarm.estimator.calibration.unknowns import Area, Modulus
from softarm.estimator.diagnosis.nuisances import BEYOND, Nuisances, layout_of, only_drawn
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


def test_areas_are_open_where_nothing_but_a_drawing_is_known():
    run, known = session("run", 1), session("known", 0, nominal=True)
    assert layout_of(model(SOPRA), [run]).of(Area).sum() == 2
    assert not layout_of(model(SOPRA), [run, known]).of(Area).any()


def test_a_calibration_on_other_recordings_is_a_reference():
    run = session("run", 1)
    for recordings, drawn in (((), True), (("run",), True), (("before",), False)):
        calibration = SOPRA.calibration.model_copy(update={"recordings": recordings})
        assert only_drawn(SOPRA.model_copy(update={"calibration": calibration}), [run]) == drawn


def test_an_area_acts_as_a_common_gain():
    layout = layout_of(model(SOPRA), [session("run", 1)])
    values = layout.means.copy()
    values[layout.names.index("area.upper")] = np.log(1.2)
    recorded = np.full((1, 6), 20e3)
    ratio = layout.setting(values).actuation.to_chamber(recorded) / layout.setting(
        layout.means
    ).actuation.to_chamber(recorded)
    np.testing.assert_allclose(ratio, [[1.2, 1.2, 1.2, 1.0, 1.0, 1.0]])

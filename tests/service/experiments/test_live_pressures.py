"""The pressures of live experiments fit the arm's own chambers."""

import numpy as np
import pytest

from softarm.estimator.specimen import load_specimen
from softarm.experiments.live_runs import first_azimuths, highest_pressures, one_side, random_levels
from tests.sim_fakes.arms import three_chambers


@pytest.mark.parametrize(("name", "chambers", "segments"), [("sopra", 6, 2), ("single_segment", 4, 1)])
def test_one_chamber_of_each_segment_stays_vented(name: str, chambers: int, segments: int) -> None:
    levels = random_levels(np.random.default_rng(1), load_specimen(name), 20)
    assert levels.shape == (20, chambers)
    np.testing.assert_array_equal((levels == 0.0).sum(axis=1), segments)


def test_no_chamber_is_filled_beyond_its_limit() -> None:
    soft = three_chambers()
    chambers = tuple(c.model_copy(update={"pressure_limit_pa": 20e3}) for c in soft.chambers)
    assert highest_pressures(soft.model_copy(update={"chambers": chambers})).tolist() == [20e3] * 3


def test_a_side_is_the_chamber_of_every_segment_that_lies_there() -> None:
    sopra = load_specimen("sopra")
    for azimuth in first_azimuths(sopra, 3):
        filled = np.flatnonzero(one_side(sopra, azimuth))
        assert [sopra.chambers[k].segment for k in filled] == ["upper", "lower"]
        assert [np.cos(sopra.chambers[k].azimuth_rad - azimuth) for k in filled] == pytest.approx([1.0, 1.0])
    np.testing.assert_array_equal(one_side(three_chambers(), 0.0) > 0.0, [True, False, False])

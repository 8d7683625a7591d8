"""A rod against states that it was not fitted to."""

import numpy as np
import pytest

from softarm.estimator.model import Inputs, Load
from softarm.estimator.rod.held_out import compare
from softarm.estimator.rod.samples import Samples
from softarm.estimator.rod.statics import place
from tests.estimator.rod import linear_rod as known
from tests.estimator.rod.linear_rod import linear_rod

STILL = np.zeros(3)


def sampled(rod, loads: np.ndarray) -> Samples:
    """Sample the rod itself under loads, shape (samples, loads)."""
    links, count = rod.chain.links, len(loads)
    lengths = np.diff(rod.chain.heights)
    places, turns = np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
    for k, own in enumerate(loads):
        strain, found = rod.solve(Inputs(np.zeros(6), own, STILL), rod.rest())
        assert found
        rotations, positions = np.zeros((links + 1, 3, 3)), np.zeros((links + 1, 3))
        rotations[0] = np.eye(3)
        place(strain, lengths, rotations, positions, np.zeros((links, 3, 3)))
        places[k], turns[k] = positions[1:], rotations[1:]
    none = np.zeros((count, links, 6, 6 + loads.shape[1]))
    return Samples(
        np.zeros((count, 6)), loads, np.zeros((count, 3)), places, turns, none, np.ones((count, links)),
        np.ones(count),
    )  # fmt: skip


def test_a_place_at_which_no_force_acts_is_left_out_of_the_error() -> None:
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
    heights = (0.6 * known.LENGTH, known.LENGTH)
    rod = linear_rod(8).with_loads(
        [Load(f"{h}_{axis}", "force", way, height=h) for h in heights for axis, way in axes.items()]
    )
    loads = np.array([[0.0, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, -0.05], [0.0, 0.0, 0.05, 0.05]])
    found = compare(rod, sampled(rod, loads), np.ones(4))
    assert found.force_rms == pytest.approx(0.0, abs=1e-4)
    assert (found.states, found.lost) == (3, 0)

"""The noise is learnt from what is left where nothing is missing."""

import numpy as np
import pytest

from softarm.estimator.diagnosis.weights import weights_of


def test_the_noise_is_learnt_by_channel_and_thinned_by_its_memory():
    rng = np.random.default_rng(3)
    white, slow = rng.normal(0.0, 0.5, 4000), rng.normal(size=4000)
    for k in range(1, 4000):
        slow[k] += 0.9 * slow[k - 1]
    weights = weights_of([("a", "b")], [np.stack([white, slow], axis=1)], [np.array([0.1, 20.0])])
    assert weights.scale["a"] == pytest.approx(0.5, rel=0.05)
    assert weights.scale["b"] == 20.0  # never below the sensor's noise
    lengths = 0.5 * (1.0 + (1.0 + 0.9) / (1.0 - 0.9))
    assert weights.effective_sample_fraction == pytest.approx(1.0 / lengths, rel=0.4)

from types import SimpleNamespace

import numpy as np

from softarm.daemon.control.mismatch import MismatchTest
from softarm.daemon.control.publishing import Publisher


def run(test, values, begin=0.0, dof=2.0):
    for index, value in enumerate(values):
        test = test.update(begin + 0.01 * index, value, dof, {"bend_tip": float(value) ** 0.5}, unix_ns=index)
    return test


def test_noise_of_the_right_size_is_consistent():
    noise = np.random.default_rng(1).chisquare(2.0, 20_000)
    test = run(MismatchTest(), noise)
    assert test.consistent
    assert 0.5 < test.ratio < 2.0


def test_mismatch_is_seen_located_and_clears_itself():
    noise = np.random.default_rng(2).chisquare(2.0, 4000)
    test = run(MismatchTest(), 5.0 * noise)
    assert not test.consistent
    assert test.suspects == ("bend_tip",)
    assert run(test, noise, begin=40.0).consistent


def test_advice_goes_on_from_the_recording_that_runs():
    publisher = Publisher("sopra", "fake", None, None, None)
    test = SimpleNamespace(consistent=False, since_unix_ns=1, suspects=("bend_tip",), ratio=9.0)
    assert publisher.mismatch(test, "/rec/a.mcap").advice == (
        "end the recording with record/stop, then run: softarm diagnose /rec/a.mcap --specimen sopra"
    )
    assert publisher.mismatch(test, None).advice.startswith("record the mismatch with record/start")


def test_one_outlier_is_no_mismatch():
    test = run(MismatchTest(), [1.0] * 100 + [1e6] + [1.0] * 100)
    assert test.consistent


def test_nothing_is_decided_without_redundancy():
    test = run(MismatchTest(), [100.0] * 1000, dof=0.0)
    assert test.consistent
    assert test.ratio is None

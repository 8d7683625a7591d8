"""The force experiment beside the gauge, on an arm that answers a pull with a known error."""

from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from softarm.common.shipped import fake_specimen
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.experiments.force import TRAVEL_M, compare_forces, summary
from softarm.experiments.live import HookPlace
from softarm.experiments.live_runs import CORD_M

STIFFNESS_N_PER_M, ERROR_N, STD_N = 10.0, 0.004, 0.003
TIP = np.array([0.0, 0.0, 0.28])


class StiffArm:
    """Stands where it is: a gauge that moves away, or pressure, pulls the cord tight."""

    def __init__(self, load_of="tip"):
        self.specimen, self.hooks, self.now = load_specimen(str(fake_specimen())), [], 0.0
        self.pull_n, self.done = 0.0, []
        message = SimpleNamespace(keys=SimpleNamespace(arm="test"), tare=lambda: self.done.append("tare"))
        message.states = lambda: self.published(lambda: SimpleNamespace(gauges_n={"tip": self.pull_n}))
        message.estimates = lambda: self.published(lambda: SimpleNamespace(loads=[self.load(load_of)]))
        self.client = message
        self.arm = lambda: self.done.append("arm")
        self.disarm = lambda: self.done.append("disarm")
        self.untie = lambda: self.done.append("untie")

    def load(self, section):
        force = np.array([self.pull_n + ERROR_N, 0.0, 0.0])
        covariance = np.diag([STD_N**2, STD_N**2, np.nan])
        return SimpleNamespace(section=section, force_n=force, covariance_n2=covariance)

    def published(self, message):
        @contextmanager
        def subscribe(take):
            yield
            take(message())

        return SimpleNamespace(subscribe=subscribe)

    def recording(self, name):
        return nullcontext([f"{name}.mcap"])

    def position(self, section):
        return TIP

    def tie(self, section, hook, length):
        self.hooks.append(HookPlace(self.now, hook))
        self.pull_n = STIFFNESS_N_PER_M * (np.linalg.norm(hook - TIP) - CORD_M)

    def go(self, pressures, ramp_s, hold_s):
        self.pull_n = 1e-5 * pressures.max()
        self.wait(ramp_s + hold_s)

    def wait(self, seconds):
        self.now += seconds


def test_estimate_and_gauge_are_compared_at_every_step_of_both_parts():
    rig, steps = StiffArm(), []
    columns, path = compare_forces(rig, lambda: steps.append(rig.now), steps=4)
    still, pressurised = summary(columns)
    assert (len(steps), path) == (8, "force.mcap")
    assert rig.done == ["untie", "tare", "untie", "arm", "disarm", "untie"]
    assert (still["condition"], pressurised["condition"]) == ("not pressurised", "pressurised")
    assert still["range_n"] == pytest.approx(STIFFNESS_N_PER_M * TRAVEL_M)
    for row in (still, pressurised):
        assert row["mean_n"] == pytest.approx(ERROR_N)
        assert row["mean_percent"] == pytest.approx(100.0 * ERROR_N / row["range_n"])
        assert row["inside_2_std"] == 1.0
    np.testing.assert_allclose(columns["pressurised"]["std_n"], STD_N)


def test_a_service_without_a_force_at_the_tip_is_named():
    with pytest.raises(InputError, match="publishes no force on tip"):
        compare_forces(StiffArm(load_of="intermediate"), lambda: None)

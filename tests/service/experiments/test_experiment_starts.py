"""What experiments begin at, and what they take for zero."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.analysis.offline.track import Waypoints
from softarm.estimator.errors import InputError
from softarm.estimator.model import Inputs, Load
from softarm.estimator.recording import POSE_SUFFIXES, Recording
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.specimen import load_specimen
from softarm.experiments.holds import hold_windows
from softarm.experiments.live import LiveRig
from softarm.experiments.live_tables import _validated
from softarm.experiments.models import NEAR_N, NEAR_PA, SharedSolutions, WarmModel
from softarm.experiments.pulls import tare
from softarm.experiments.seed import SeedResult


def test_each_pull_is_tared_by_the_rest_before_it() -> None:
    forces = np.array([[0.1, 0.0], [0.3, 0.0], [5.0, 1.0], [np.nan, np.nan], [0.5, 0.2], [6.0, 1.0]])
    free = np.array([True, True, False, False, True, False])
    zero = tare(forces, free)
    np.testing.assert_allclose(zero[[2, 3, 5], 0], [0.2, 0.2, 0.5])
    np.testing.assert_allclose(zero[[2, 5], 1], [0.0, 0.2])


def test_without_a_rest_before_it_a_pull_is_left_as_it_is() -> None:
    np.testing.assert_allclose(tare(np.ones((3, 2)), np.zeros(3, dtype=bool)), 0.0)


def test_a_small_step_between_two_holds_parts_them() -> None:
    time = np.arange(0.0, 11.0, 0.01)
    level = np.interp(time, [0, 5, 6, 11], [2e4, 2e4, 2.3e4, 2.3e4])
    windows = hold_windows(Recording("run", time, {"pressure_cmd_0_pa": level}))
    np.testing.assert_allclose(windows[:, 1], [5.0, 10.99], atol=0.05)


class Recorder:
    """A model that records what it was given to begin at."""

    sections, regions, loads, chambers = ("tip",), ("upper",), (), 6

    def __init__(self) -> None:
        self.starts: list[object] = []

    def evaluate(self, *args: Any, start: object, **options: Any) -> ArmResponse:
        self.starts.append(start)
        return cast(ArmResponse, SimpleNamespace(number=len(self.starts)))


def test_a_model_begins_at_the_newest_response_to_nearly_the_same_nodes() -> None:
    inner = Recorder()
    model = WarmModel(cast(Any, inner), SharedSolutions())
    pressures, loads = np.full((2, 6), 2e4), np.zeros((2, 3))
    first = model.evaluate(BatchInputs(pressures, loads, np.zeros(3)))
    second = model.evaluate(BatchInputs(pressures + 0.5 * NEAR_PA, loads, np.zeros(3)))
    assert inner.starts == [None, first]
    assert model.evaluate(BatchInputs(pressures, loads, np.zeros(3))) is not None
    assert inner.starts[2] is second
    for other in ((pressures[:1], loads[:1]), (pressures, loads + 2 * NEAR_N), (10 * pressures, loads)):
        model.evaluate(BatchInputs(*other, np.zeros(3)))
        assert inner.starts[-1] is None
    model.evaluate(BatchInputs(pressures, loads, np.zeros(3)), start=first)
    assert inner.starts[-1] is first


@pytest.mark.parametrize("names", [("tip_x", "tip_y"), ("tip_y", "intermediate_x", "tip_x")])
def test_a_waypoint_serves_models_with_other_loads(names: tuple[str, ...]) -> None:
    known = Inputs(np.full(6, 1e4), np.array([0.3, -0.2]), np.array([0.0, 0.0, 9.81]))
    waypoints = Waypoints(("tip_x", "tip_y"), [None, ("state", known)])
    assert waypoints.at(0, ()) is None
    assert waypoints.at(2, ()) is None
    found = waypoints.at(1, [Load(name, "force", (1.0, 0.0, 0.0), section="tip") for name in names])
    assert found is not None
    wanted = {"tip_x": 0.3, "tip_y": -0.2}
    np.testing.assert_allclose(found[1].loads, [wanted.get(name, 0.0) for name in names])
    np.testing.assert_allclose(found[1].pressures, 1e4)
    assert found[0] == "state"


def test_a_silent_gauge_is_named_before_anybody_pulls() -> None:
    class Client:
        keys = SimpleNamespace(arm="sopra")

        def states(self) -> Any:
            return self

        def wait_for(self, accept: Any, timeout_s: float) -> Any:
            if not accept(SimpleNamespace(gauges_n={"tip": None})):
                raise TimeoutError
            return None

        def state(self) -> Any:
            lost = {"where": "orientation_tip", "message": "no reading yet", "hint": "check its cable"}
            return SimpleNamespace(
                findings=[SimpleNamespace(code="stale_sensor", **lost), SimpleNamespace(code="other")]
            )

    bench = LiveRig(cast(Any, Client()), cast(Any, None), cast(Any, None))
    with pytest.raises(InputError, match="sopra, gauge of tip: publishes nothing; switch it on"):
        bench.require_gauge()
    assert bench.lost() == ["orientation_tip: no reading yet; check its cable"]


def test_without_the_pose_of_the_tip_nothing_is_held_against_the_paper() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    pose = {f"frame_intermediate_{part}": np.full(200, float(part == "qw")) for part in POSE_SUFFIXES}
    recording = Recording("validate", time, pose | {"pressure_0_pa": np.zeros(200)})
    with pytest.raises(InputError, match="has no pose of tip; bring its markers into view"):
        _validated(load_specimen("sopra"), (recording,), SeedResult(1))

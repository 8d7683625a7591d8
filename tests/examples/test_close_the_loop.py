"""The loop's example: what it watches and how it tells it; the loop itself needs minutes."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from softarm.experiments.excitation_plan import manoeuvres_of
from softarm_client.messages import Estimate, LoadEstimate, Mismatch, State

FILE = Path(__file__).parents[2] / "examples" / "close_the_loop.py"


@pytest.fixture(scope="module")
def loop() -> ModuleType:
    spec = importlib.util.spec_from_file_location("close_the_loop", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def estimate(*forces: tuple[float, float, float], status: str = "converged") -> Estimate:
    loads = [LoadEstimate.model_construct(section="tip", force_n=one, covariance_n2=()) for one in forces]
    return Estimate.model_construct(status=status, loads=tuple(loads))


def state(asked_pa: float) -> State:
    return State.model_construct(asked_pa=(asked_pa, *[0.0] * 5))


def mismatch(value: float, *, consistent: bool) -> Mismatch:
    return Mismatch.model_construct(normalised_innovation_squared=value, consistent=consistent)


def test_forces_and_verdicts_are_summed_up(loop: ModuleType):
    seen = loop.Watch()
    seen.add_estimate(estimate((9.0, 0.0, 0.0)))
    seen.add_state(state(2e4))
    seen.add_estimate(estimate((0.0, 0.2, 0.0), (0.0, 0.1, 0.0)))
    seen.add_estimate(estimate((0.0, 0.4, 0.0), (0.0, 0.0, 0.0)))
    seen.add_estimate(estimate((9.0, 0.0, 0.0), status="not_converged"))
    seen.add_mismatch(mismatch(4.0, consistent=False))
    seen.add_mismatch(mismatch(1.0, consistent=True))
    row = seen.row("plain")
    assert row["apparent_force_n"] == pytest.approx(0.35)
    assert row["inconsistent_percent"] == 50.0
    assert row["innovation_squared"] == 2.5


def test_nothing_seen_is_no_number(loop: ModuleType):
    row = loop.Watch().row("plain")
    assert np.isnan([value for key, value in row.items() if key != "specimen"]).all()


def test_the_fake_arm_has_its_manoeuvres(loop: ModuleType):
    from softarm.estimator.specimen import load_specimen

    names = {manoeuvre.name for manoeuvre in manoeuvres_of(load_specimen(loop.fake_specimen()))}
    assert {*loop.SUSPECT, loop.WATCHED} <= names


def test_it_says_how_it_is_used(loop: ModuleType):
    told = CliRunner().invoke(loop.main, ["--help"])
    assert told.exit_code == 0
    assert "--out" in told.output

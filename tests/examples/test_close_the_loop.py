"""The loop's example: what it watches and how it tells it; the loop itself needs minutes."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from softarm.experiments.excitation_plan import manoeuvres_of
from softarm_client.messages import Estimate, LoadEstimate, Mismatch

FILE = Path(__file__).parents[2] / "examples" / "close_the_loop.py"


@pytest.fixture(scope="module")
def loop() -> ModuleType:
    spec = importlib.util.spec_from_file_location("close_the_loop", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def estimate(force: tuple[float, float, float], status: str = "converged") -> Estimate:
    loads = (LoadEstimate.model_construct(section="tip", force_n=force, covariance_n2=()),)
    return Estimate.model_construct(status=status, loads=loads)


def mismatch(value: float, *, consistent: bool) -> Mismatch:
    return Mismatch.model_construct(normalised_innovation_squared=value, consistent=consistent)


def test_forces_and_verdicts_are_summed_up(loop: ModuleType):
    seen = loop.Watch()
    seen.add_estimate(estimate((0.3, 0.0, 0.0)))
    seen.add_estimate(estimate((0.0, 0.4, 0.0)))
    seen.add_estimate(estimate((9.0, 0.0, 0.0), "not_converged"))
    seen.add_mismatch(mismatch(4.0, consistent=False))
    seen.add_mismatch(mismatch(1.0, consistent=True))
    row = seen.row("plain")
    assert row["apparent_force_n"] == pytest.approx(0.35)
    assert row["inconsistent_percent"] == 50.0
    assert row["innovation_squared"] == 2.5


def test_nothing_seen_is_no_number(loop: ModuleType):
    assert np.isnan(loop.Watch().force_n)


def test_its_manoeuvres_are_on_the_menu_of_the_fake_arm(loop: ModuleType):
    from softarm.estimator.specimen import load_specimen

    menu = {manoeuvre.name for manoeuvre in manoeuvres_of(load_specimen(loop.fake_specimen()))}
    assert {*loop.SUSPECT, loop.WATCHED} <= menu


def test_it_says_how_it_is_used(loop: ModuleType):
    told = CliRunner().invoke(loop.main, ["--help"])
    assert told.exit_code == 0
    assert "--out" in told.output

"""Several fake arms live: each is calibrated before anything else is done on it, as a laboratory does."""

from pathlib import Path

import numpy as np
import pytest

from softarm.common.tables import Table
from softarm.experiments import live_tables
from softarm.experiments.live import LiveRigSettings
from softarm.experiments.live_runs import CORD_M, pull_steps
from softarm.experiments.live_tables import ExperimentInteraction, run_live_arms
from softarm.experiments.seed import SeedResult

QUIET = ExperimentInteraction(lambda _: None, lambda _: None, lambda: None)
ROW = {"condition": "pressurised", "paper_mean_percent": 1.2, "aim_percent": 0.6}


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int | None, str | None]]:
    done = []

    def run_live(
        name: str, settings: LiveRigSettings, seed: int, _: ExperimentInteraction
    ) -> tuple[tuple[Table, ...], SeedResult]:
        done.append((name, settings.variant, settings.specimen and Path(settings.specimen).parent.name))
        result = SeedResult(seed)
        result.add("force", [{**ROW, "mean_percent": 0.2 * seed, "inside_2_std": 0.9}])
        return (Table(name, []),), result

    monkeypatch.setattr(live_tables, "run_live", run_live)
    return done


def test_each_arm_is_calibrated_first(runs: list[tuple[str, int | None, str | None]], tmp_path: Path) -> None:
    aims, *_ = run_live_arms("force", LiveRigSettings(tmp_path), 2, QUIET)
    assert runs == [
        ("calibrate", 1, None),
        ("force", 1, "seed1"),
        ("calibrate", 2, None),
        ("force", 2, "seed2"),
    ]
    assert aims.rows[0]["mean"] == pytest.approx(0.3)
    assert (tmp_path / "force.json").exists()


def test_a_calibration_that_is_given_serves_all(
    runs: list[tuple[str, int | None, str | None]], tmp_path: Path
) -> None:
    run_live_arms("force", LiveRigSettings(tmp_path, specimen="lab/known.toml"), 2, QUIET)
    assert runs == [("force", 1, "lab"), ("force", 2, "lab")]


def test_calibrating_alone_gives_the_tables_of_every_arm(
    runs: list[tuple[str, int | None, str | None]], tmp_path: Path
) -> None:
    tables = run_live_arms("calibrate", LiveRigSettings(tmp_path), 3, QUIET)
    assert [run[0] for run in runs] == ["calibrate"] * 3
    assert len(tables) == 3


class Pulled:
    """An arm that stays drawn aside for a while once a cord was on it."""

    def __init__(self) -> None:
        self.place, self.hooks = np.zeros(3), []

    def position(self, section: str) -> np.ndarray:
        return self.place

    def tie(self, section: str, hook: np.ndarray, length: float) -> None:
        self.hooks.append(hook)
        self.place = 0.1 * hook

    def wait(self, seconds: float) -> None: ...

    untie = advance = lambda self: None


def test_every_pull_begins_at_the_rest_before_the_first() -> None:
    arm = Pulled()
    pull_steps(arm, "tip", azimuths=(0.0, 2.0), steps=2, travel=0.05, rest_s=0.0)  # type: ignore[arg-type]
    reach = [np.linalg.norm(hook) for hook in arm.hooks]
    np.testing.assert_allclose(reach, [CORD_M, CORD_M + 0.05] * 2)

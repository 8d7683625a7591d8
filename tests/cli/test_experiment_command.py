"""What ``softarm experiment`` takes and refuses, and how its tables are joined."""

import pytest

from softarm.cli import run
from softarm.experiments.campaign import default_jobs, summary, tables_of
from softarm.experiments.page import experiments_page
from softarm.experiments.seed import SeedResult

REFUSED = {
    "nothing named": (["force"], "give either --fake or --arm ID"),
    "both named": (["force", "--fake", "--arm", "sopra"], "give either --fake or --arm ID"),
    "recorded on an arm": (["validate", "--arm", "sopra", "--recorded"], "--recorded needs --fake"),
    "a scenario on an arm": (
        ["force", "--arm", "sopra", "--scenario", "day.toml"],
        "--scenario needs --fake",
    ),
    "a scenario, recorded": (["all", "--fake", "--scenario", "day.toml"], "--scenario needs --fake"),
    "arms of one arm": (["force", "--arm", "sopra", "--seeds", "2"], "--seeds needs --fake"),
    "a specimen that is not there": (["force", "--fake", "--specimen", "sopraa"], "did you mean 'sopra'?"),
    "the same, recorded": (["all", "--fake", "--specimen", "sopraa"], "did you mean 'sopra'?"),
    "all on an arm": (["all", "--arm", "sopra"], "run each experiment on its own"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_use_is_one_line_and_status_2(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words, message = REFUSED[name]
    assert run(["experiment", *words]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert len(told.strip().splitlines()) == 1


def result(number: int, percent: float) -> SeedResult:
    made = SeedResult(number)
    row = {"condition": "not pressurised", "mean_percent": percent, "inside_2_std": 0.94}
    made.add("force", [row | {"paper_mean_percent": 1.05, "aim_percent": 0.5}])
    made.add("sensors", [row])
    return made


def test_an_aim_counts_the_mean_over_the_seeds() -> None:
    for percents, met in (((0.3, 0.6), True), ((0.5, 0.6), False)):
        table = summary(result(number, percent) for number, percent in enumerate(percents))
        (row,) = table.rows
        assert row["seeds"] == 2
        assert row["mean"] == pytest.approx(sum(percents) / 2)
        assert row["worst_seed"] == max(percents)
        assert row["aim_met"] is met


def test_what_failed_is_said_and_the_rest_is_shown() -> None:
    sick = SeedResult(7, notes=["teach failed: the fake arm: no end"], failed=["teach"])
    table = summary([result(1, 0.4), sick])
    assert any("Seed 7: teach failed" in note for note in table.notes)
    page = experiments_page((table, *tables_of([result(1, 0.4), sick])), 2)
    assert "--seeds 2" in page
    assert "| 1 | not pressurised |" in page


def test_no_more_processes_than_seeds() -> None:
    assert default_jobs(1) == 1
    assert default_jobs(100) >= 1

"""Folders of sealed trials are read whole, or refused with what is missing; a run goes through them all."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from softarm.bench.diagnosis import command
from softarm.bench.trials.folders import read_answer, read_trials
from softarm.estimator.errors import InputError


def recording(folder: Path) -> Path:
    """Write a recording of a valve alone, in which nothing is concealed but a bias of 3 kPa."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(7)
    lines = ["t_s,pressure_cmd_0_pa,pressure_0_pa"]
    for k in range(600):
        asked = 2e4 * ((k // 100) % 2)
        lines.append(f"{0.02 * k:.2f},{asked:.0f},{asked + 3e3 * (asked > 0) + rng.normal(0, 20):.1f}")
    (folder / "recording.csv").write_text("\n".join(lines) + "\n")
    (folder / "recording.toml").write_text('specimen = "sopra"\nrate_hz = 50.0\n')
    return folder


@pytest.fixture
def trials(tmp_path: Path) -> Path:
    folder = tmp_path / "trials"
    recording(folder / "one" / "questioned" / "00")
    (folder / "one" / "trial.toml").write_text('specimen = "sopra"\n')
    (folder / "README.md").write_text("not a trial")
    return folder


def test_a_trial_is_read_with_its_recordings(trials: Path):
    (trial,) = read_trials(trials)
    assert (trial.name, trial.specimen, trial.nominal) == ("one", "sopra", ())
    assert [path.name for path in trial.questioned] == ["00"]


def test_a_specimen_beside_the_trial_is_taken(trials: Path):
    (trials / "one" / "arm.toml").write_text("")
    (trials / "one" / "trial.toml").write_text('specimen = "arm.toml"\n')
    assert read_trials(trials)[0].specimen == str(trials / "one" / "arm.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "names no specimen"),
        (
            'specimen = "arm.toml"',
            r"trial.toml, specimen: there is no 'arm.toml' in this folder.*put it there",
        ),
        ("specimen = ", "is not TOML"),
        (None, "holds no trial"),
    ],
)
def test_a_folder_that_is_not_complete_is_refused(
    trials: Path, text: str | None, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").touch()  # which is not beside the trial
    file = trials / "one" / "trial.toml"
    file.unlink() if text is None else file.write_text(text)
    with pytest.raises(InputError, match=words):
        read_trials(trials)


def test_answers_are_read_or_refused(tmp_path: Path):
    (tmp_path / "one.toml").write_text(
        'kind = "single"\nmotion = "ordinary"\n[[concealed]]\neffect = "line_lag"\n'
        "where = {chamber = 2}\nsize = {lag = 0.3}\n"
    )
    answer = read_answer(tmp_path, "one")
    assert (answer.kind, answer.motion, answer.concealed[0].size) == ("single", "ordinary", {"lag": 0.3})
    with pytest.raises(InputError, match="cannot be read"):
        read_answer(tmp_path, "two")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('kind = "double"', "kind: 'double' is not known; give one of single"),
        ('kind = "single"', "concealed: a trial of kind single conceals 1 effects, 0 are listed"),
        ('kind = "null"\n[[concealed]]\neffect = "line_lag"', "concealed: a trial of kind null conceals 0"),
        ('kind = "single"\n[concealed]\neffect = "line_lag"', r"concealed: .* is not a list"),
        ('kind = "single"\n[[concealed]]\nwhere = {}', r"concealed\[0\]\.effect: missing"),
        ('kind = "single"\n[[concealed]]\neffect = "a"\nwhere = "tip"', r"concealed\[0\]\.where"),
        (
            'kind = "single"\n[[concealed]]\neffect = "a"\nsize = {bias = "3 kPa"}',
            r"concealed\[0\]\.size.*: '3 kPa' is not a number",
        ),
        ('kind = "single"\n[[concealed]]\neffect = "a"\nsize = {bias = nan}', r"concealed\[0\]\.size"),
    ],
)
def test_an_answer_that_is_malformed_is_refused_by_its_field(tmp_path: Path, text: str, words: str):
    (tmp_path / "one.toml").write_text(text)
    with pytest.raises(InputError, match=rf"one\.toml: {words}") as caught:
        read_answer(tmp_path, "one")
    assert "\n" not in str(caught.value)


def test_trials_are_diagnosed_scored_and_not_done_twice(trials: Path, tmp_path: Path):
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "one.toml").write_text(
        'kind = "single"\n[[concealed]]\neffect = "pressure_bias"\nwhere = {chamber = 0}\n'
        "size = {bias = 3e3}\n"
    )
    words = ["--trials", str(trials), "--answers", str(answers), "--out", str(tmp_path / "out"), "--json"]
    first = CliRunner().invoke(command, words, standalone_mode=False)
    assert first.return_value == 0, first.output
    tables = {table["title"]: table["rows"] for table in json.loads(first.stdout)["tables"]}
    assert tables["Diagnoses"][0]["trial"] == "one"
    assert "pressure_bias" in tables["Diagnoses"][0]["findings"]
    assert tables["Trials that went wrong"] == []
    again = CliRunner().invoke(command, words, standalone_mode=False)
    assert json.loads(again.stdout) == json.loads(first.stdout)


def test_scores_of_a_source_are_written_beside_those_of_others(trials: Path, tmp_path: Path):
    answers, page = tmp_path / "answers", tmp_path / "proof.md"
    answers.mkdir()
    (answers / "one.toml").write_text('kind = "null"\n')
    page.write_text("Words.\n\n**Blind trials: other arm**\n\n| of |\n|---|\n| 7 |\n")
    words = ["--trials", str(trials), "--out", str(tmp_path / "out"), "--write", str(page)]
    refused = CliRunner().invoke(command, words)
    assert (refused.exit_code, "need --answers" in refused.output) == (2, True)
    words += ["--answers", str(answers), "--source", "a valve"]
    assert CliRunner().invoke(command, words, standalone_mode=False).return_value == 0
    written = page.read_text()
    assert written.startswith("Words.\n\n**Blind trials: other arm**")
    assert "**Blind trials: a valve**" in written

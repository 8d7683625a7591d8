"""The hand that the proof plants into kept trials."""

from pathlib import Path

import numpy as np
import pytest

from acceptance.proof.touches import SECONDS, SHARES, Touch, touched_trial
from softarm.bench.trials.folders import Trial
from softarm.estimator.rotations import from_quaternions, log
from softarm.recordings import load_recording, save_recording
from tests.estimator.intake import small_arm as arm

TOUCH = Touch(run=1, moment=0.5, angle=0.2, azimuth=0.7)


@pytest.mark.parametrize("section", ["intermediate", "tip"])
def test_a_hand_turns_and_moves_the_sections_and_lets_them_go(section: str) -> None:
    before = arm.small_arm(seconds=40.0)
    after = TOUCH.on(before)
    share, lever = SHARES[section]
    begin = TOUCH.begin(before)
    held = (before.time > begin + 1.0) & (before.time < begin + SECONDS - 1.0)
    free = (before.time < begin) | (before.time > begin + SECONDS)
    frames = [
        from_quaternions(np.column_stack([one.columns[f"frame_{section}_q{letter}"] for letter in "wxyz"]))
        for one in (before, after)
    ]
    turn = log(frames[1] @ np.swapaxes(frames[0], -1, -2))
    assert np.linalg.norm(turn[held], axis=-1) == pytest.approx(0.2 * share, rel=1e-6)
    moved = np.column_stack(
        [
            after.columns[f"frame_{section}_{axis}_m"] - before.columns[f"frame_{section}_{axis}_m"]
            for axis in "xy"
        ]
    )
    side = np.array([np.cos(0.7), np.sin(0.7)])
    assert moved[held] @ side == pytest.approx(0.2 * lever, rel=1e-6)
    assert turn[held][0] == pytest.approx(0.2 * share * np.array([-side[1], side[0], 0.0]), abs=1e-9)
    assert np.allclose(turn[free], 0.0, atol=1e-9)
    assert np.array_equal(moved[free], np.zeros_like(moved[free]))


def test_only_the_recording_that_is_touched_is_written_anew(tmp_path: Path) -> None:
    runs = []
    for name in ("run_0", "run_1"):
        save_recording(arm.small_arm(seconds=40.0), tmp_path / name / "recording.csv")
        runs.append(tmp_path / name)
    trial = Trial("trial", "sopra", (), tuple(runs))
    touched = touched_trial(trial, TOUCH, tmp_path / "touched")
    assert touched.questioned == (runs[0], tmp_path / "touched" / "run_1")
    found, before = load_recording(touched.questioned[1]), load_recording(runs[1])
    assert (found.name, found.info) == (before.name, before.info)
    changed = [name for name in before.columns if not np.allclose(found.columns[name], before.columns[name])]
    assert changed
    assert not any(name.startswith("pressure_") for name in changed)
    assert Touch.drawn(trial) == Touch.drawn(trial)
    assert Touch.drawn(trial) != Touch.drawn(Trial("another", "sopra", (), trial.questioned))

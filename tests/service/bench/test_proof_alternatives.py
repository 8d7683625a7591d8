"""The alternatives are given a fair chance: each explains what it can represent."""

import numpy as np
import pytest

from acceptance.proof.alternatives import SMOOTH, Bends, alignment, chosen_by, faded, learned, sindy
from acceptance.proof.schedule import SealedTrial
from acceptance.proof.trial import Folders, forget

PLAIN = (1e-3, 1.0)
"""Ridge and width."""


def run(seed: int, law) -> Bends:
    rng = np.random.default_rng(seed)
    time = 0.25 * np.arange(240)
    pressures = np.repeat(rng.uniform(0.0, 50e3, (12, 6)), 20, axis=0)
    pressures[:20] = 0.0
    before = pressures[:, :4] / 50e3 * 0.5
    return Bends(time, pressures, before + law(time, pressures, before), before, before)


def static(time, pressures, before) -> np.ndarray:
    return 0.1 * before**2 + 0.05 * pressures[:, [5]] / 50e3


def creeping(time, pressures, before) -> np.ndarray:
    return 0.2 * faded(time, before, 5.0)


def left(predict, one: Bends) -> float:
    return float(np.sqrt(np.mean((one.measured - predict(one)) ** 2) / np.mean(one.left**2)))


def test_a_static_law_is_learned():
    train = [run(seed, static) for seed in range(4)]
    assert left(learned(train, PLAIN, memory=False), run(9, static)) < 0.15


def test_only_memory_learns_what_creeps():
    train = [run(seed, creeping) for seed in range(4)]
    test = run(9, creeping)
    with_memory, without = (learned(train, PLAIN, memory=memory) for memory in (True, False))
    assert left(with_memory, test) < 0.5 * left(without, test)


def test_sindy_finds_a_residual_that_follows_first_order_dynamics():
    pytest.importorskip("pysindy")
    train = [run(seed, creeping) for seed in range(4)]
    assert left(sindy(train, (5e-3, 2)), run(9, creeping)) < 0.1


def test_options_are_chosen_by_runs_that_no_fit_has_seen():
    """Where nothing but noise is left, the stiffest map is the best one."""

    def noise(time, pressures, before) -> np.ndarray:
        return np.random.default_rng(int(pressures.sum())).normal(0.0, 0.02, before.shape)

    train = [run(seed, noise) for seed in range(3)]
    options = []
    chosen_by(
        train, SMOOTH, lambda runs, option: options.append(option) or learned(runs, option, memory=False)
    )
    assert options[-1][0] == max(ridge for ridge, _ in SMOOTH)


def test_axes_of_sensors_are_learnt_from_what_is_nominal():
    turn, offset = np.array([[0.98, 0.17], [-0.17, 0.98]]), 0.02

    def askew(time, pressures, before) -> np.ndarray:
        parts = [before[:, :2] @ turn, before[:, 2:] @ turn]
        return np.concatenate(parts, axis=1) + offset - before

    align = alignment([run(seed, askew) for seed in range(2)])
    np.testing.assert_allclose(align(run(9, askew)).left, 0.0, atol=1e-9)


def test_fading_follows_a_step():
    time = np.linspace(0.0, 20.0, 401)
    step = np.where(time > 0.0, 1.0, 0.0)[:, None]
    assert faded(time, step, 4.0)[200, 0] == pytest.approx(1.0 - np.exp(-10.0 / 4.0), abs=0.01)


def test_forgetting_a_trial_keeps_the_pull(tmp_path):
    trial, folders = SealedTrial("null", 1), Folders(tmp_path)
    for name in ("run_01_ramps_hanging", "run_09_pulled_steps_hanging"):
        (folders.recordings(trial) / name).mkdir(parents=True)
    forget(trial, folders)
    assert [path.name for path in folders.recordings(trial).iterdir()] == ["run_09_pulled_steps_hanging"]

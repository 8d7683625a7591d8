"""Sealed trials are fair: what they conceal, their designed runs excite, at sizes from faint to strong."""

from pathlib import Path

import numpy as np
import pytest

from acceptance.trial import PlantTrial, draw
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.excitation import LONG, inventory
from softarm.estimator.specimen import save_specimen
from softarm.fakes.plant.chain import gravity_in_base
from softarm.fakes.plant.effects import ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS, effect
from softarm.fakes.plant.manoeuvre import SAMPLE
from tests.sim_fakes.arms import three_chambers

LIMITS = np.full(6, 65e3)
SEEDS = range(30)


def excited(trial: PlantTrial) -> frozenset:
    """What the suspect runs of a trial excite together."""
    found, gravities, end = frozenset(), [], 0.0
    for run in trial.runs:
        if run.name.startswith("nominal"):
            continue
        commands = run.manoeuvre.commands[::10]
        time = 10 * SAMPLE * np.arange(len(commands))
        gravity = np.asarray(gravity_in_base(run.laboratory.arm))
        found |= inventory(time, commands, np.tile(gravity, (len(time), 1)), LIMITS)
        gravities.append(gravity)
        end = run.laboratory.session_start + run.manoeuvre.duration
    turned = any(abs(g @ gravities[0]) < 0.5 * (g @ g) for g in gravities)
    return found | ({"mount_turned"} if turned else set()) | ({"long_run"} if end >= LONG else set())


@pytest.mark.parametrize("seed", [0, 1])
def test_the_designed_runs_excite_whatever_may_be_concealed(seed: int):
    found = excited(draw(seed, "single"))
    for name in (*ARM_EFFECTS, *INSTRUMENT_EFFECTS):
        assert EFFECTS[name].needs <= found, name


def test_every_effect_of_the_vocabulary_is_drawn_and_no_other():
    drawn = {one.name for seed in range(250) for one in draw(seed, "single").concealed}
    assert drawn == set(EFFECTS) == {*ARM_EFFECTS, *INSTRUMENT_EFFECTS}


def test_a_foreign_effect_is_a_law_that_nobody_chose():
    drawn = [draw(seed, "foreign").concealed for seed in range(60)]
    assert {one.name for concealed in drawn for one in concealed} == {"random_law"}
    assert len({int(concealed[0].parameters["law"]) for concealed in drawn}) == 60


@pytest.mark.parametrize("name", sorted({*ARM_EFFECTS, *INSTRUMENT_EFFECTS, *FOREIGN_EFFECTS}))
def test_sizes_are_graded_from_faint_to_strong(name: str):
    known, kind = effect(name), "foreign" if name in FOREIGN_EFFECTS else "single"
    quantity = known.quantities[known.principal]
    sizes = np.array([draw(s, kind, only=(name,)).concealed[0].parameters[known.principal] for s in SEEDS])
    low, high = sorted((quantity.low, quantity.high))
    assert np.all((sizes >= low) & (sizes <= high))
    strong = max(abs(quantity.low), abs(quantity.high))
    assert np.abs(sizes).max() > 0.6 * strong
    assert np.abs(sizes).min() < 0.6 * strong


def test_a_trial_is_of_the_arm_that_is_drawn(tmp_path: Path):
    drawing = three_chambers()
    save_specimen(drawing, tmp_path / "arm.toml")
    places = {"segment": {"upper"}, "chamber": {0, 1, 2}, "section": {"tip"}, "sensor": {"frame_tip"}}
    for seed in range(20):
        trial = draw(seed, "pair", specimen=str(tmp_path / "arm.toml"))
        for one in trial.concealed:
            assert all(one.where[place] in places[place] for place in set(one.where) & set(places))
        for run in trial.runs:
            assert run.laboratory.specimen == str(tmp_path / "arm.toml")
            assert run.laboratory.arm.sections == ("base", "tip")
            assert run.manoeuvre.commands.shape[1] == 3
            assert run.manoeuvre.commands.max() <= min(drawing.pressure_limits)
    another = draw(0, "pair", specimen=str(tmp_path / "arm.toml"))
    assert another.runs[0].laboratory.arm != trial.runs[0].laboratory.arm  # its tolerances are its own


def test_before_and_after_are_one_arm_in_one_laboratory():
    trial = draw(3, "pair")
    nominal = [run for run in trial.runs if run.name.startswith("nominal")]
    suspect = [run for run in trial.runs if run.name.startswith("run")]
    assert all(not run.laboratory.concealed for run in nominal)
    assert all(run.laboratory.concealed == trial.concealed for run in suspect)
    assert {run.laboratory.arm.segments for run in trial.runs} == {trial.runs[0].laboratory.arm.segments}
    assert all(run.laboratory.instruments is trial.runs[0].laboratory.instruments for run in trial.runs)
    assert len({run.seed for run in trial.runs}) == len(trial.runs)

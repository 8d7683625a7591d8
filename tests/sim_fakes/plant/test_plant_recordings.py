import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from acceptance.plant import real_time_factor
from acceptance.trial import KINDS, draw
from softarm.estimator.errors import InputError
from softarm.fakes.plant.__main__ import main, parse_effect
from softarm.fakes.plant.effects import ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS, Concealed
from softarm.fakes.plant.generate import Generated, Laboratory, generate
from softarm.fakes.plant.instruments import InstrumentQuality, Streams
from softarm.fakes.plant.manoeuvre import PlantManoeuvre, chain
from softarm.fakes.plant.manoeuvres import (
    LIBRARY,
    SOPRA,
    directions,
    each_alone,
    growing_cycles,
    pulled_steps,
    random_holds,
    rest,
    taught,
)
from softarm.fakes.plant.mounts import MOUNTS, turned
from softarm.fakes.plant.parameters import ArmParameters
from softarm.fakes.plant.variants import variant
from softarm.fakes.plant.write import write
from softarm.recordings.load import load_recording


@pytest.fixture(scope="module")
def laboratory(small: ArmParameters) -> Laboratory:
    return Laboratory(arm=replace(small, step=5e-3))


@pytest.fixture(scope="module")
def holds(laboratory: Laboratory) -> Generated:
    manoeuvre = random_holds(np.random.default_rng(4), seconds=12.0, hold=3.0)
    return generate(replace(laboratory, streams=Streams(markers=True)), manoeuvre, seed=5)


@pytest.mark.parametrize("name", LIBRARY)
def test_every_manoeuvre_stays_within_the_safe_pressures(name: str) -> None:
    manoeuvre = LIBRARY[name](np.random.default_rng(2), SOPRA)
    assert manoeuvre.commands.shape[1] == 6
    assert 10.0 < manoeuvre.duration < 200.0
    assert manoeuvre.commands.min() >= 0.0
    assert manoeuvre.commands.max() <= 65e3
    for event in (*manoeuvre.pulls, *manoeuvre.grips):
        assert event.start + event.samples <= len(manoeuvre.commands)


def test_growing_cycles_grow_and_each_alone_is_alone() -> None:
    cycles = growing_cycles(chambers=(1,)).commands
    peaks = cycles[:, 1].reshape(8, -1).max(axis=1)
    assert np.all(np.diff(peaks[::2]) > 0.0)
    np.testing.assert_allclose(peaks[::2], peaks[1::2])
    assert cycles[:, [0, 2, 3, 4, 5]].max() == 0.0
    assert (each_alone().commands > 0.0).sum(axis=1).max() == 1


def test_chained_manoeuvres_keep_their_pulls() -> None:
    pull = pulled_steps(count=2, ways=directions(1))
    both = chain("both", rest(1.0), pull, pull)
    assert len(both.commands) == 100 + 2 * len(pull.commands)
    assert [one.start for one in both.pulls] == [
        100 + pull.pulls[0].start,
        100 + len(pull.commands) + pull.pulls[0].start,
    ]


def test_the_columns_are_canonical_and_hold_together(holds: Generated, tmp_path: Path) -> None:
    write(holds, tmp_path / "run", tmp_path / "truth")
    recording = load_recording(tmp_path / "run")
    assert recording.chambers == tuple(range(6))
    assert recording.frames == ("base", "intermediate", "tip")
    assert recording.bends == ("intermediate", "tip")
    assert recording.gauges == ("cord",)
    assert len(recording.markers) == 10
    np.testing.assert_allclose(np.diff(recording.time), 0.01, atol=1e-9)
    pose = recording.pose("tip")
    np.testing.assert_allclose(np.linalg.norm(pose[:, 3:], axis=1)[~np.isnan(pose[:, 0])], 1.0, atol=1e-6)
    assert recording.info["gravity_m_s2"] == [0.0, 0.0, 9.81]
    assert tomllib.loads((tmp_path / "truth" / "truth.toml").read_text())["effects"] == []
    assert "effect" not in (tmp_path / "run" / "recording.toml").read_text()
    with pytest.raises(InputError, match="exists"):
        write(holds, tmp_path / "run")


def test_the_noise_is_that_of_real_recordings(holds: Generated) -> None:
    bends = np.degrees(holds.columns["bend_tip_x_rad"])
    second = bends[2:] - 2.0 * bends[1:-1] + bends[:-2]
    jitter = 1.4826 * np.nanmedian(np.abs(second)) / np.sqrt(6.0)
    assert 0.01 < jitter < 0.08
    given, asked = holds.columns["pressure_0_pa"], holds.columns["pressure_cmd_0_pa"]
    settled = np.abs(np.diff(asked, prepend=0.0)) < 1.0
    settled &= np.roll(settled, 100) & (asked > 10e3)
    assert -1.2e3 < np.median(given[settled] - asked[settled]) < -0.2e3


def test_bodies_are_lost_in_short_gaps(laboratory: Laboratory) -> None:
    often = replace(laboratory, instruments=InstrumentQuality(losses=1.0))
    lost = np.isnan(generate(often, rest(20.0), seed=1).columns["frame_tip_x_m"])
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    assert 0.02 < lost.mean() < 0.2
    assert np.median(np.diff(edges)[::2]) <= 14


def test_the_same_seed_gives_the_same_recording(laboratory: Laboratory, holds: Generated) -> None:
    manoeuvre = random_holds(np.random.default_rng(4), seconds=3.0, hold=3.0)
    first, again = (generate(laboratory, manoeuvre, seed=5) for _ in range(2))
    other = generate(laboratory, manoeuvre, seed=6)
    for name, column in first.columns.items():
        np.testing.assert_array_equal(column, again.columns[name])
    np.testing.assert_array_equal(first.time, other.time)
    assert np.nanmax(np.abs(first.columns["bend_tip_x_rad"] - other.columns["bend_tip_x_rad"])) > 0.0


def test_clocks_may_be_apart(laboratory: Laboratory) -> None:
    swing = PlantManoeuvre("swing", 15e3 * (1.0 + np.sin(np.arange(400)[:, None] * 0.05)) * np.eye(6)[0])
    quiet = InstrumentQuality(angle_noise=0.0, angle_wander=0.0, losses=0.0)
    late = generate(replace(laboratory, instruments=replace(quiet, offset=0.05)), swing, seed=1)
    prompt = generate(replace(laboratory, instruments=quiet), swing, seed=1)
    now, then = prompt.columns["bend_intermediate_x_rad"], late.columns["bend_intermediate_x_rad"]
    np.testing.assert_allclose(then[105:], now[100:-5], atol=1e-4)


def test_the_gauge_reads_the_pull_in_grams_at_its_own_rate(laboratory: Laboratory) -> None:
    run = generate(laboratory, pulled_steps(count=5, ways=directions(1)), seed=1)
    gauge = run.columns["gauge_cord_n"]
    read = ~np.isnan(gauge)
    assert read.mean() == pytest.approx(0.2, abs=0.01)
    np.testing.assert_allclose(gauge[read], run.run.cord_force[read], atol=0.03)
    assert gauge[read].max() > 0.05
    tied = ~np.isnan(run.columns["marker_hook_x_m"])
    assert 0.0 < tied.mean() < 1.0
    assert run.run.cord_force[~tied].max() == 0.0


def test_a_hand_teaches_poses(laboratory: Laboratory) -> None:
    run = generate(laboratory, taught(np.random.default_rng(1), count=2, hold=1.0), seed=1).run
    moved = np.linalg.norm(run.poses[:, 2, :3] - run.poses[0, 2, :3], axis=1)
    assert moved.max() > 0.01
    assert np.abs(run.forces[:, 2]).max() > 0.05
    assert np.abs(run.forces[-50:]).max() == 0.0


def test_strips_repeat_their_value(laboratory: Laboratory) -> None:
    strips = replace(laboratory, streams=Streams(bends="strips", frames=(), gauge=False))
    columns = generate(strips, rest(3.0), seed=1).columns
    assert not any(name.startswith(("frame", "gauge")) for name in columns)
    assert np.mean(np.diff(columns["bend_tip_x_rad"]) == 0.0) > 0.9


def test_gravity_follows_the_mount(laboratory: Laboratory) -> None:
    sideways = generate(laboratory.mounted(MOUNTS["sideways"]), rest(1.0), seed=1)
    gravity = np.array(sideways.info["gravity_m_s2"])
    np.testing.assert_allclose(np.abs(gravity), [9.81, 0.0, 0.0], atol=1e-9)
    bend = np.array([sideways.columns[f"bend_intermediate_{axis}_rad"] for axis in "xy"])
    np.testing.assert_allclose(np.nanmean(bend, axis=1) @ gravity[:2] > 0.5, True)
    assert turned().quaternion == pytest.approx(MOUNTS["hanging"].quaternion)


def test_a_session_warms_and_drifts_on(laboratory: Laboratory) -> None:
    warming = (Concealed("thermal_drift", {}, {"change": 0.4, "time": 100.0}), Concealed("sensor_drift"))
    manoeuvre = random_holds(np.random.default_rng(1), seconds=3.0, hold=3.0)
    early, late = (
        generate(replace(laboratory, concealed=warming, session_start=start), manoeuvre, seed=1)
        for start in (0.0, 300.0)
    )
    assert early.time[0] == late.time[0] == 0.0
    bends = [np.linalg.norm(one.run.poses[-1, 2, :2]) for one in (early, late)]
    assert bends[1] < 0.95 * bends[0]


def test_variants_differ_at_the_spread_asked_for() -> None:
    assert variant(3).arm == variant(3).arm
    assert variant(3).arm != variant(4).arm
    moduli = [variant(seed).arm.segments[0].modulus for seed in range(30)]
    assert 0.04 < np.std(moduli) / np.mean(moduli) < 0.12
    gains = np.array([variant(seed).arm.actuation.gains for seed in range(30)])
    assert 0.015 < gains.std() < 0.05
    still = variant(3, spread=0.0).arm
    assert len({*still.actuation.gains}) == 1
    assert variant(3, background=0.0).arm.segments[0].memory.relaxation == (0.0, 0.0, 0.0)


def test_trials_are_drawn_from_their_kind() -> None:
    inside = {*ARM_EFFECTS, *INSTRUMENT_EFFECTS}
    for seed in range(6):
        kinds = {kind: draw(seed, kind) for kind in KINDS}
        assert [len(kinds[kind].concealed) for kind in KINDS] == [0, 1, 2, 3, 1]
        assert kinds["foreign"].concealed[0].name in FOREIGN_EFFECTS
        assert {one.name for one in kinds["triple"].concealed} <= inside
        assert kinds["pair"].concealed == draw(seed, "pair").concealed
        for run in kinds["pair"].runs:
            assert bool(run.laboratory.concealed) == run.name.startswith("run_")
    assert draw(1, "single", only=("tip_payload",)).concealed[0].name == "tip_payload"
    with pytest.raises(InputError, match="one of null"):
        draw(1, "quadruple")


@pytest.mark.parametrize("name", sorted({*ARM_EFFECTS, *INSTRUMENT_EFFECTS, *FOREIGN_EFFECTS}))
def test_every_drawn_effect_can_be_recorded(name: str, laboratory: Laboratory) -> None:
    kind = "foreign" if name in FOREIGN_EFFECTS else "single"
    concealed = draw(2, kind, only=(name,)).concealed
    run = generate(replace(laboratory, concealed=concealed), rest(0.3), seed=1)
    assert run.truth["effects"][0]["effect"] == name
    assert np.isfinite(run.run.poses).all()


def test_the_command_line_lists_the_effects_and_tells_mistakes(tmp_path: Path) -> None:
    listed = CliRunner().invoke(main, ["effects"])
    assert listed.exit_code == 0
    assert len(listed.output.splitlines()) == len(ARM_EFFECTS | INSTRUMENT_EFFECTS | FOREIGN_EFFECTS)
    wrong = CliRunner().invoke(main, ["record", str(tmp_path / "run"), "--effect", "tip_payload mas=1"])
    assert str(wrong.exception) == "effect 'tip_payload': no parameter 'mas'; one of mass, below"


def test_an_effect_is_read_from_words() -> None:
    read = parse_effect("chamber_gain change=-0.1 chamber=3")
    assert read == Concealed("chamber_gain", {"chamber": 3}, {"change": -0.1})
    for wrong in ("chamber_gain change", "chamber_gain change=low"):
        with pytest.raises(InputError):
            parse_effect(wrong)


@pytest.mark.parametrize("words", [["--effect", ""], ["--commands", "commands.csv"]])
def test_a_run_that_cannot_be_made_or_written_is_refused(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = [f"pressure_cmd_{chamber}_pa" for chamber in range(6)]
    Path("commands.csv").write_text(",".join(["t_s", *names]) + "\n0,0,0,0,0,0,0\n0.1,0,0,0,0,0,0\n")
    done = CliRunner().invoke(main, ["record", "commands.csv/run", *words])
    assert isinstance(done.exception, InputError)
    assert CliRunner().invoke(main, ["record", "run", "--seed", "-1"]).exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["commands.csv"]


def test_the_speed_is_measured() -> None:
    assert real_time_factor("all chambers, taut cord", 0.1) > 0.0


def test_a_table_of_pressures_is_followed(tmp_path: Path) -> None:
    table = tmp_path / "commands.csv"
    names = [f"pressure_cmd_{chamber}_pa" for chamber in range(6)]
    rows = ("0,0,0,0,0,0,0", "1,20000,0,0,0,0,10000", "1.5,20000,0,0,0,0,10000")
    table.write_text("\n".join([",".join(["t_s", *names]), *rows]) + "\n")
    done = CliRunner().invoke(main, ["record", str(tmp_path / "run"), "--commands", str(table)])
    assert done.exit_code == 0, done.output
    told = load_recording(tmp_path / "run")
    assert told.time[-1] == pytest.approx(1.49, abs=0.02)
    assert told.columns["pressure_cmd_0_pa"][50] == pytest.approx(1e4, rel=0.02)
    assert told.columns["pressure_cmd_5_pa"][-1] == 1e4
    assert told.info["manoeuvre"] == "commands"


def test_a_table_that_lacks_a_chamber_is_refused(tmp_path: Path) -> None:
    (tmp_path / "commands.csv").write_text("t_s,pressure_cmd_0_pa\n0,0\n")
    done = CliRunner().invoke(
        main, ["record", str(tmp_path / "run"), "--commands", str(tmp_path / "commands.csv")]
    )
    assert isinstance(done.exception, InputError)
    assert "give a CSV with columns t_s" in str(done.exception)

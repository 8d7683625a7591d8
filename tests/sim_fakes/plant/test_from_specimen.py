"""Fake arms of any specimen: they bend as they should, and are not the estimator's own model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner

from softarm.estimator.errors import InputError
from softarm.estimator.specimen import Specimen, load_specimen, save_specimen
from softarm.fakes.devices import DeviceSurroundings, build_node
from softarm.fakes.faults import FaultBoard
from softarm.fakes.parts import ValvesPart
from softarm.fakes.placement import with_placed_instruments, with_specimen
from softarm.fakes.plant.__main__ import main
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.from_specimen import arm_of
from softarm.fakes.plant.parameters import sopra
from softarm.fakes.plant.state import PlantInputs
from softarm.fakes.scenario import read_scenario
from tests.sim_fakes.arms import of_a_mesh_file, three_chambers


def bends(specimen: Specimen, chamber: int) -> np.ndarray:
    parameters = replace(arm_of(specimen, 0).arm, step=4e-3)
    pressures = np.zeros(len(specimen.chambers))
    pressures[chamber] = 0.5 * specimen.pressure_limits[chamber]
    arm = FakeArm(parameters)
    arm.advance(2.0, PlantInputs(pressures))
    return arm.state.bends


@pytest.mark.parametrize("name", ["three", "single_segment"])
def test_each_chamber_bends_its_arm_away_from_itself(name: str) -> None:
    specimen = three_chambers() if name == "three" else load_specimen(name)
    for chamber in specimen.chambers:
        x, y = bends(specimen, chamber.index)[0]
        assert 0.2 < np.hypot(x, y) < 1.0
        away = np.arctan2(y, x) - chamber.azimuth_rad - np.pi
        assert abs(np.angle(np.exp(1j * away))) < 0.15


def test_a_calibrated_copy_names_the_same_arm_and_neither_has_the_estimators_stiffness() -> None:
    specimen = three_chambers()
    calibrated = specimen.model_copy(
        update={
            "gravity_m_s2": (0.0, 0.2, 9.808),
            "calibration": specimen.calibration.model_copy(update={"modulus_scale": {"upper": 1.3}}),
        }
    )
    one, other = arm_of(specimen, 3).arm, arm_of(calibrated, 3).arm
    assert one.mount == other.mount
    assert [s.modulus for s in one.segments] == [s.modulus for s in other.segments]
    young = specimen.materials["soft"].young
    assert abs(one.segments[0].modulus / young - 1.0) > 0.1
    assert min(abs(gain - 1.0) for gain in one.actuation.gains) > 1e-4
    assert arm_of(specimen, 4).arm.segments[0].modulus != one.segments[0].modulus


def test_the_shape_of_sopra_is_played_by_its_own_fake() -> None:
    assert arm_of(load_specimen("sopra"), 0).arm == sopra()


def test_a_mesh_file_has_the_cross_section_of_the_body_it_was_made_of(tmp_path: Path) -> None:
    meshed = arm_of(of_a_mesh_file(tmp_path), 0).arm.segments[0].cross_sections[2]
    drawn = arm_of(three_chambers(), 0).arm.segments[0].cross_sections[2]
    assert meshed.chamber_areas == pytest.approx(drawn.chamber_areas, rel=0.05)
    assert meshed.chambers == pytest.approx(drawn.chambers, abs=5e-4)
    assert meshed.second_moment == pytest.approx(drawn.second_moment, rel=0.08)


def test_a_mesh_without_a_hollow_where_a_chamber_is_said_to_be_is_refused(tmp_path: Path) -> None:
    specimen = of_a_mesh_file(tmp_path)
    turned = [c.model_copy(update={"azimuth_rad": c.azimuth_rad + 1.0}) for c in specimen.chambers]
    wrong = specimen.model_copy(update={"chambers": tuple(turned)}).placed_in(tmp_path)
    with pytest.raises(InputError, match=r"chambers\[0\].*no closed hollow towards 1 rad"):
        arm_of(wrong, 0)


def test_an_arm_without_chambers_is_refused() -> None:
    with pytest.raises(InputError, match="has no chambers"):
        arm_of(load_specimen("beam"), 0)


def test_a_run_is_recorded_with_the_chambers_and_sections_of_the_specimen(tmp_path: Path) -> None:
    save_specimen(three_chambers(), tmp_path / "tri.toml")
    pl.DataFrame({"t_s": [0.0, 0.5], **{f"pressure_cmd_{k}_pa": [0.0, 2e4] for k in range(3)}}).write_csv(
        tmp_path / "commands.csv"
    )
    words = [str(tmp_path / "run"), "--specimen", str(tmp_path / "tri.toml")]
    result = CliRunner().invoke(main, ["record", *words, "--commands", str(tmp_path / "commands.csv")])
    assert result.exit_code == 0, result.output
    columns = pl.read_csv(tmp_path / "run" / "recording.csv").columns
    assert [name for name in columns if name.startswith("pressure_") and "cmd" not in name] == [
        "pressure_0_pa", "pressure_1_pa", "pressure_2_pa"
    ]  # fmt: skip
    assert {name.split("_")[1] for name in columns if name.startswith("frame_")} == {"base", "tip"}


def test_the_instruments_of_a_scenario_move_to_the_arm_of_a_specimen(tmp_path: Path) -> None:
    save_specimen(three_chambers(), tmp_path / "tri.toml")
    scenario = with_specimen(read_scenario("bench"), str(tmp_path / "tri.toml"))
    arm = FakeArm(replace(arm_of(three_chambers(), 0).arm, step=4e-3))
    devices = {device.name: device for device in with_placed_instruments(scenario, arm).device}
    assert devices["valves"].valve_map == (0, 1, 2)
    assert [body.section for body in devices["qtm"].bodies] == ["base", "tip"]
    assert devices["bend"].sensors == ("upper",)
    assert scenario.cord is None
    assert with_specimen(read_scenario("bench"), "sopra") == read_scenario("bench")


def test_a_device_that_says_where_it_is_stays_there() -> None:
    part = ValvesPart(name="valves", kind="festo_mpa", valve_map=(0, 1))
    arm = FakeArm(replace(arm_of(three_chambers(), 0).arm, step=4e-3))
    with pytest.raises(InputError, match="valve_map has 2 entries, the arm has 3 chambers"):
        build_node(part, DeviceSurroundings(arm, 1), FaultBoard("valves", ()))

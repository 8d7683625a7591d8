"""Specimen files: what is read is what was written, and every error is named."""

import subprocess
import sys
from pathlib import Path

import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.geometry import build_mesh
from softarm.estimator.specimen import (
    SHIPPED,
    Calibration,
    Parameter,
    Physics,
    Place,
    SpecimenError,
    Value,
    load_specimen,
    parse_specimen,
    save_specimen,
)

TEXT = (Path(__file__).parents[3] / "estimator/softarm/estimator/specimen/shipped/sopra.toml").read_text(
    "utf-8"
)


def error_of(*changes: tuple[str, str]) -> InputError:
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(InputError) as caught:
        parse_specimen(text.encode(), "arm.toml")
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.mark.parametrize("name", SHIPPED)
def test_round_trip(name: str, tmp_path: Path) -> None:
    specimen = load_specimen(name)
    save_specimen(specimen, tmp_path / "copy.toml")
    copy = load_specimen(tmp_path / "copy.toml")
    assert copy.placed_in(specimen.folder) == specimen
    assert copy.folder == tmp_path


def test_calibration_and_physics_survive_the_round_trip(tmp_path: Path) -> None:
    physics = Physics(
        effect="tip_payload",
        where=Place(section="tip"),
        parameters={"mass": Parameter(value=0.052, std=0.001, unit="kg")},
        recordings=("beam_a",),
    )
    calibration = Calibration(modulus_scale={"upper": Value(value=1.2, std=0.03)}, recordings=("rest",))
    specimen = load_specimen("sopra").model_copy(update={"physics": (physics,), "calibration": calibration})
    save_specimen(specimen, tmp_path / "arm.toml")
    copy = load_specimen(tmp_path / "arm.toml")
    assert copy.physics == (physics,)
    assert copy.calibration.scale("upper") == 1.2
    assert copy.calibration.scale("lower") == 1.0


def test_the_earlier_key_of_the_quadratic_gain_is_read_and_the_present_one_written(tmp_path: Path) -> None:
    earlier = "\n[[calibration.chambers]]\nindex = 2\nbow_per_pa2 = { value = 4e-11, std = 5e-12 }\n"
    specimen = parse_specimen((TEXT + earlier).encode(), "arm.toml")
    assert specimen.calibration.chamber(2).quadratic_gain_per_pa2 == Value(value=4e-11, std=5e-12)
    save_specimen(specimen, tmp_path / "arm.toml")
    assert "quadratic_gain_per_pa2" in (tmp_path / "arm.toml").read_text()
    assert "bow_per_pa2" not in (tmp_path / "arm.toml").read_text()


def test_mesh_path_follows_the_file(tmp_path: Path) -> None:
    start = TEXT.index("[geometry]")
    end = TEXT.index("[materials.shore_10a]")
    text = f'{TEXT[:start]}[geometry]\nkind = "mesh_file"\npath = "arm.msh"\n\n{TEXT[end:]}'
    (tmp_path / "arm.toml").write_text(text, "utf-8")
    (tmp_path / "other").mkdir()
    specimen = load_specimen(tmp_path / "arm.toml")
    save_specimen(specimen, tmp_path / "other" / "arm.toml")
    moved = load_specimen(tmp_path / "other" / "arm.toml")
    assert moved.geometry.kind == "mesh_file"
    assert (moved.folder / moved.geometry.path).resolve() == (tmp_path / "arm.msh").resolve()


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    for place, what in (
        (tmp_path / "file" / "arm.toml", "cannot be written"),
        (tmp_path / "folder", "not a file"),
    ):
        with pytest.raises(InputError, match=what):
            save_specimen(load_specimen("beam"), place)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "folder"]


def test_missing_keys_are_named_with_their_meaning() -> None:
    with pytest.raises(InputError) as caught:
        parse_specimen(b"", "arm.toml")
    told = str(caught.value)
    assert "geometry: missing, add it: Shape of the body;" in told
    assert "`" not in told


def test_missing_folders_are_made(tmp_path: Path) -> None:
    save_specimen(load_specimen("beam"), tmp_path / "absent" / "arm.toml")
    assert load_specimen(tmp_path / "absent" / "arm.toml").name == "beam"


@pytest.mark.parametrize(
    ("change", "where", "what", "cure"),
    [
        (("wall_m = 0.002", "wall_m = -1.0"), "arm.toml: geometry.wall_m", "-1.0 is not above 0", "above"),
        (("wall_m = 0.002", 'wall_m = "2 mm"'), "arm.toml: geometry.wall_m", "'2 mm' is not a", "number"),
        (("wall_m = 0.002", "wall_m = nan"), "arm.toml: geometry.wall_m", "not a finite number", "finite"),
        (("[clamp]", "[clmp]"), "arm.toml: clmp", "unknown key", "did you mean 'clamp'"),
        (("swept_lobes", "swept_lobe"), "arm.toml: geometry.kind", "'swept_lobe'", "'swept_lobes'"),
        (("neo_hookean", "neohookean"), "arm.toml: materials.shore_10a.law", "not known", "'neo_hookean'"),
        (("index = 3", "index = 4"), "arm.toml: chambers[3].index", "4 where 3", "number the chambers"),
        (("azimuth_rad = 0.0", "azimuth_rad = 120"), "arm.toml: chambers[0].azimuth_rad", "120", "6.28"),
        (("azimuth_rad = 0.0", "azimuth_rad = 0.3"), "arm.toml: chambers", "120 degrees", "evenly"),
        (("shore_30a", "shore_20a"), "arm.toml: sections[0].material", "shore_30a", "did you mean"),
        (("lobe_radii_m = [0.0175, ", "lobe_radii_m = ["), "arm.toml: geometry", "5 lobe radii for 6", "one"),
        (("9.81]", "9810.0]"), "arm.toml: gravity_m_s2", "9810", "m/s2"),
        (("= 65000.0", "= 65.0"), "arm.toml: chambers[0].pressure_limit_pa", "65 is too little", "pascals"),
        (
            ("density_kg_m3 = 1070.0", "density_kg_m3 = 1.07"),
            "arm.toml: materials.shore_10a.density_kg_m3",
            "1.07",
            "kg/m3",
        ),
        (("mass_kg = 0.160", "mass_kg = 160.0"), "arm.toml: segments[0].mass_kg", "160", "kilograms"),
    ],
)
def test_one_mistake_names_field_value_and_cure(
    change: tuple[str, str], where: str, what: str, cure: str
) -> None:
    if change[0] == "shore_30a":
        change = ("[materials.shore_30a]", "[materials.shore_20a]")
    error = error_of(change)
    if isinstance(error, SpecimenError):
        first = error.problems[0]
        assert f"arm.toml: {first.field}" == where
        assert what in first.what
        assert cure in first.cure
        return
    assert error.where == where
    assert what in error.what
    assert cure in error.cure


def test_azimuths_may_be_rounded_as_a_file_rounds_them() -> None:
    text = TEXT.replace("azimuth_rad = 2.0943951023932", "azimuth_rad = 2.0944")
    assert text.count("2.0944") == 2
    build_mesh(parse_specimen(text.encode(), "arm.toml"))
    error = error_of(("azimuth_rad = 2.0943951023932", "azimuth_rad = 2.09"))
    assert "120 degrees apart" in error.what


def test_a_short_vector_is_one_error_and_not_its_consequences_too() -> None:
    error = error_of(("frame_origin_m = [0.0, 0.0, 0.0]", "frame_origin_m = [0.0, 0.0]"))
    assert error.where == "arm.toml: sections[0].frame_origin_m[2]"
    longer = error_of(("frame_origin_m = [0.0, 0.0, 0.0]", "frame_origin_m = [0.0, 0.0, 0.0, 1.0]"))
    assert longer.what == "holds 4 where it takes at most 3"


def test_all_errors_are_reported_together() -> None:
    error = error_of(
        ("wall_m", "wal_m"),
        ("pressure_limit_pa = 65000.0", "pressure_limit_pa = 0"),
        ('name = "tip"', 'nam = "tip"'),
    )
    assert isinstance(error, SpecimenError)
    fields = {problem.field for problem in error.problems}
    assert {"geometry.wal_m", "chambers[0].pressure_limit_pa", "sections[2].nam"} <= fields


def test_a_gap_in_the_stack_is_named() -> None:
    error = error_of(("to_m = 0.151\n", "to_m = 0.150\n"))
    assert error.where == "arm.toml: segments[1].from_m"
    assert "'lower' begins at 0.151 m but 'intermediate' ends at 0.15 m" in error.what


def test_syntax_errors_name_the_line() -> None:
    error = error_of(("wall_m = 0.002", "wall_m == 0.002"))
    line = 1 + TEXT[: TEXT.index("wall_m = ")].count("\n")
    assert f"line {line}" in error.what


def test_an_absent_file_suggests_the_shipped_name() -> None:
    with pytest.raises(InputError, match="did you mean 'sopra'"):
        load_specimen("sopr")


def test_importing_the_description_stays_light() -> None:
    heavy = "('numpy', 'scipy', 'numba')"
    code = f"import sys, softarm.estimator.specimen; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"

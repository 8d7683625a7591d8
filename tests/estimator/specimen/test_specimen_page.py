"""The page of the specimen file says what the models read."""

from pathlib import Path

from pydantic import BaseModel

from softarm.estimator.specimen.page import TABLES, specimen_page

PAGE = Path(__file__).parents[3] / "docs" / "specimen.md"


def test_the_page_is_in_step_with_the_models() -> None:
    assert PAGE.read_text("utf-8") == specimen_page(), (
        "run python -m softarm.estimator.specimen.page > docs/specimen.md"
    )


def test_every_key_has_a_meaning_and_every_quantity_a_unit() -> None:
    for title, model in TABLES:
        assert issubclass(model, BaseModel)
        for name, field in model.model_fields.items():
            assert field.description, f"{title}: {name}"
    rows = [line for line in specimen_page().splitlines() if line.startswith("| `")]
    units = {line.split("|")[1].strip(): line.split("|")[2].strip() for line in rows}
    assert units["`membrane_stiffness_n_m`"] == "N/m"
    assert units["`density_kg_m3`"] == "kg/m3"
    assert units["`pressure_limit_pa`"] == "Pa"
    assert units["`gravity_m_s2`"] == "m/s2"
    assert units["`outer_radius_m`"] == "m"

"""The reference pages say what the models read."""

import tomllib
from pathlib import Path

import pytest

from acceptance.reference import PAGES, configuration, specimen

DOCS = Path(__file__).parents[3] / "docs"


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_in_step_with_the_definitions(name):
    assert (DOCS / name).read_text("utf-8") == PAGES[name](), "run: softarm bench reference"


def test_examples_are_valid_tables():
    assert specimen.EXAMPLES
    for model, text in specimen.EXAMPLES.items():
        (table,) = tomllib.loads(text).values()
        assert set(table) == set(model.model_validate(table).model_dump(exclude_unset=True))


def test_every_key_of_the_configuration_has_a_meaning():
    rows = [line.split("|") for line in configuration.render().splitlines() if line.startswith("| `")]
    assert len(rows) > 25
    assert [cells[1] for cells in rows if not cells[4].strip()] == []


def test_every_key_of_a_specimen_has_a_meaning_and_every_quantity_a_unit():
    for title, model in specimen.TABLES:
        for name, field in model.model_fields.items():
            assert field.description, f"{title}: {name}"
    rows = [line for line in specimen.render().splitlines() if line.startswith("| `")]
    units = {line.split("|")[1].strip(): line.split("|")[2].strip() for line in rows}
    assert units["`membrane_stiffness_n_m`"] == "N/m"
    assert units["`density_kg_m3`"] == "kg/m3"
    assert units["`pressure_limit_pa`"] == "Pa"
    assert units["`gravity_m_s2`"] == "m/s2"
    assert units["`outer_radius_m`"] == "m"

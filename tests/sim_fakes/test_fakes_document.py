"""docs/fakes.md names every key of a scenario and every fault."""

from pathlib import Path

from softarm.fakes.control import REQUEST
from softarm.fakes.devices import catalogue
from softarm.fakes.parts import PART_OF_KIND, BodyPart
from softarm.fakes.scenario import CordPart, FaultPart, PlantPart, Scenario, check_scenario

TEXT = (Path(__file__).parents[2] / "docs" / "fakes.md").read_text()


def test_every_key_is_documented():
    tables = [Scenario, PlantPart, CordPart, FaultPart, BodyPart, *PART_OF_KIND.values()]
    keys = {key for table in tables for key in table.model_fields} - {"device", "fault", "plant", "cord"}
    assert {key for key in keys if key not in TEXT} == set()


def test_every_fault_is_documented_with_its_parameters():
    missing = []
    for kind in PART_OF_KIND:
        part = check_scenario({"device": [{"name": "it", "kind": kind}]}).device[0]
        assert f"`{kind}`" in TEXT
        for fault in catalogue(part):
            row = f"| `{fault.name}` | {'times' if fault.once else 'until cleared'} | {fault.text} |"
            missing += [row] if row not in TEXT else []
            missing += [name for name in fault.parameters if f"`{name} = " not in TEXT]
    assert missing == []


def test_every_request_is_documented():
    schema = REQUEST.json_schema()
    for verb in schema["discriminator"]["mapping"]:
        assert f'{{"do": "{verb}"' in TEXT

"""The reference of the configuration, from its models."""

import json
import re
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from acceptance.reference.api import limits, type_name
from softarm.daemon.settings import (
    ControlSettings,
    PageSettings,
    SafetySettings,
    SensorSettings,
    ServiceConfig,
)
from softarm.drivers.registry import KINDS
from softarm_client.session import NetworkSettings

TABLES: dict[str, type[BaseModel]] = {
    "[network]": NetworkSettings,
    "[page]": PageSettings,
    "[control]": ControlSettings,
    "[safety]": SafetySettings,
    "[[sensors]]": SensorSettings,
}
ARGUMENT = re.compile(r"^        (\w+): (.*?)(?=^        \w+: |\Z)", re.M | re.S)
"""An entry of the section ``Args:`` of a docstring."""
INTRODUCTION = """# Configuration of the service

Generated from the models by `softarm bench reference`.

One TOML file describes one arm and its service: `softarm serve --config FILE`. Relative paths start at the
folder of the file. Names of keys carry the unit.

- `softarm check FILE` reports every mistake at once, an unknown key with the nearest known one.
- `softarm doctor --config FILE` opens the devices.
- `softarm fakes --scenario demo --config FILE` writes a configuration that fits simulated instruments.
- `deploy/config/sopra.toml` is an example of a laboratory.
"""


def render() -> str:
    """Write the page."""
    top = {name: field for name, field in ServiceConfig.model_fields.items() if not _is_table(name)}
    parts = [INTRODUCTION, "## Top of the file", _keys(ServiceConfig, top)]
    for heading, model in TABLES.items():
        parts += [f"## `{heading}`", _keys(model, model.model_fields)]
    kinds = ", ".join(f"`{kind}`" for kind in KINDS)
    parts += [
        "## `[[devices]]`",
        f"Each has a `name` and a `kind`: {kinds}.",
        "The other keys depend on the kind: see [Drivers](drivers.md).",
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _is_table(name: str) -> bool:
    return name == "devices" or any(heading.strip("[]") == name for heading in TABLES)


def _keys(model: type[BaseModel], fields: dict[str, FieldInfo]) -> str:
    told = _arguments(model)
    rows = ["| key | type | default | meaning |", "|---|---|---|---|"]
    for name, field in fields.items():
        meaning = " ".join((field.description or told.get(name, "")).split()).replace("``", "`")
        kind = type_name(field.annotation)
        rows.append(f"| `{name}` | {kind} | {_default(name, field)} | {meaning}{limits(field)} |")
    return "\n".join(rows)


def _arguments(model: type[BaseModel]) -> dict[str, str]:
    """Read what the docstring of a model says of its fields."""
    section = (model.__doc__ or "").partition("Args:\n")[2]
    return {name: text.strip() for name, text in ARGUMENT.findall(section)}


def _default(name: str, field: FieldInfo) -> str:
    if name == "arm":
        return "name of the file"
    if field.is_required():
        return "required"
    value = str(field.default) if isinstance(field.default, Path) else field.default
    return "none" if value is None else f"`{json.dumps(value)}`"

"""The API page ``docs/api.md``, generated from the messages: ``python -m softarm.api.page > docs/api.md``."""

import json
import sys
from enum import Enum
from types import NoneType
from typing import Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from softarm.api.commands import VERBS, Applied, Refused
from softarm.api.keys import PREFIX
from softarm.api.messages import (
    STREAMS,
    Contact,
    HealthFinding,
    LeaseState,
    LoadEstimate,
    SectionPose,
    Stamp,
)
from softarm.api.modes import Mode
from softarm.daemon.safety.modes import PRESSURISED, TRANSITIONS

SHARED: tuple[type[BaseModel], ...] = (
    Stamp,
    HealthFinding,
    SectionPose,
    LeaseState,
    LoadEstimate,
    Contact,
)


def schemas() -> dict[str, object]:
    """Collect the JSON schemas of every stream, request and reply, by name."""
    streams = {name: model.model_json_schema() for name, model in STREAMS.items()}
    requests = {f"command/{verb}": model.model_json_schema() for verb, model in VERBS.items()}
    replies = {model.__name__: model.model_json_schema() for model in (Applied, Refused)}
    return {"schema": "softarm.schema/1", "streams": streams, "requests": requests, "replies": replies}


def _type_name(annotation: object) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is NoneType:
        return "null"
    if origin is Literal:
        return " or ".join(f"`{json.dumps(value)}`" for value in arguments)
    if origin is tuple:
        kinds = [_type_name(a) for a in arguments if a is not Ellipsis]
        return f"array of {kinds[0]}" + ("" if Ellipsis in arguments else f", {len(kinds)} long")
    if origin is dict:
        return f"object of {_type_name(arguments[1])}"
    if arguments:
        return " or ".join(_type_name(a) for a in arguments)
    if isinstance(annotation, type):
        return _plain_name(annotation)
    return "any"


def _plain_name(kind: type) -> str:
    if issubclass(kind, BaseModel):
        return f"[{kind.__name__}](#{kind.__name__.lower()})"
    if issubclass(kind, Enum):
        return "string"
    names = {float: "number", int: "integer", str: "string", bool: "boolean", object: "any"}
    return names.get(kind, kind.__name__)


def _field_row(name: str, field: FieldInfo) -> str:
    default = "" if field.is_required() else f" Default `{json.dumps(field.default)}`."
    return f"| `{name}` | {_type_name(field.annotation)} | {(field.description or '') + default} |"


def _fields(model: type[BaseModel], without: frozenset[str] = frozenset()) -> list[str]:
    rows = [_field_row(name, field) for name, field in model.model_fields.items() if name not in without]
    return ["| field | type | meaning |", "|---|---|---|", *rows, ""] if rows else []


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split())


def _verb_section(verb: str, model: type[BaseModel]) -> list[str]:
    common = frozenset(("deadline_unix_ns", "sequence", "client", "lease"))
    needs = "needs the lease" if "lease" in model.model_fields and verb != "lease/acquire" else "free to all"
    own = _fields(model, common if verb != "lease/acquire" else common - {"lease"})
    return [f"### `{verb}`", "", f"{needs.capitalize()}.", "", *own]


def _transition_table() -> list[str]:
    rows = [f"| {before} | {event} | {after} |" for (before, event), after in TRANSITIONS.items()]
    return ["| in | on | goes to |", "|---|---|---|", *rows, ""]


def render() -> str:
    """Render the page as Markdown."""
    lines = [
        "# API",
        "",
        "Generated from the message definitions by `python -m softarm.api.page`.",
        "",
        f"Keys begin with `{PREFIX}/<arm>/`. Payloads are JSON. Field names carry their unit.",
        "The same definitions as JSON schemas: query `schema`.",
        "",
        "## Streams",
        "",
        "Published without blocking: a slow subscriber loses messages. A late joiner gets the last one.",
        "",
    ]
    for name, model in STREAMS.items():
        lines += [f"### `{name}`", "", _summary(model), "", *_fields(model)]
    lines += [
        "### `shape`",
        "",
        "Not JSON: x, y, z [m] and von Mises stress [Pa] of every node of the specimen's mesh, little-endian",
        "float32, published while somebody listens.",
        "",
        "## Shared parts",
        "",
    ]
    for part in SHARED:
        lines += [f"### {part.__name__}", "", _summary(part), "", *_fields(part)]
    lines += [
        "## Commands",
        "",
        "Query `command/<verb>` with the request as payload. There is one reply: `Applied`, or the error",
        "`Refused`.",
        "Every request carries:",
        "",
        *_fields(VERBS["disarm"]),
    ]
    for verb, request in VERBS.items():
        lines += _verb_section(verb, request)
    for answer in (Applied, Refused):
        lines += [f"### {answer.__name__}", "", _summary(answer), "", *_fields(answer)]
    pressurised = ", ".join(mode for mode in Mode if mode in PRESSURISED)
    lines += [
        "## Modes",
        "",
        f"The valves may hold pressure in {pressurised}; in every other mode they are vented.",
        "",
        *_transition_table(),
    ]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    sys.stdout.write(render())

"""The API page, from the messages."""

import json
from enum import Enum
from pathlib import Path
from types import NoneType
from typing import Annotated, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from acceptance.reference.api_examples import EXAMPLES, TOKEN
from softarm.daemon.safety.modes import BEFORE_READY, PRESSURISED, TRANSITIONS
from softarm_client.commands import VERBS, Applied, GuardedRequest, MovingRequest, Refused, Request
from softarm_client.keys import PREFIX
from softarm_client.messages import (
    STREAMS,
    Contact,
    HealthFinding,
    LeaseState,
    LoadEstimate,
    SectionPose,
    Stamp,
    Surface,
)
from softarm_client.modes import Mode

STOP = (
    "Open to all clients that may send commands, in every mode, ahead of all other commands. Any payload "
    "or none is accepted. `softarm/@v1/*/command/stop` stops every arm."
)
SHARED: tuple[type[BaseModel], ...] = (
    Stamp,
    HealthFinding,
    SectionPose,
    LeaseState,
    LoadEstimate,
    Contact,
    Surface,
)


def type_name(annotation: object) -> str:
    """Name the type of a field in words of JSON."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is NoneType:
        return "null"
    if origin is Annotated:
        return type_name(arguments[0])
    if origin is Literal:
        return " or ".join(f"`{json.dumps(value)}`" for value in arguments)
    if origin is tuple:
        kinds = [type_name(a) for a in arguments if a is not Ellipsis]
        return f"array of {kinds[0]}" + ("" if Ellipsis in arguments else f", {len(kinds)} long")
    if origin is dict:
        return f"object of {type_name(arguments[1])}"
    if arguments:
        return " or ".join(type_name(a) for a in arguments)
    if isinstance(annotation, type):
        return _plain_name(annotation)
    return "any"


def _plain_name(kind: type) -> str:
    if issubclass(kind, BaseModel):
        return f"[{kind.__name__}](#{kind.__name__.lower()})"
    if issubclass(kind, Enum):
        return "string"
    names = {float: "number", int: "integer", str: "string", bool: "boolean", object: "any", Path: "path"}
    return names.get(kind, kind.__name__)


LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
LENGTHS = {"min_length": "at least {} long", "max_length": "at most {} long"}


def limits(field: FieldInfo) -> str:
    """Write the limits of a field in words."""
    found = []
    for entry in field.metadata:
        found += [f"{word} {getattr(entry, name):g}" for name, word in LIMITS.items() if hasattr(entry, name)]
        found += [word.format(getattr(entry, name)) for name, word in LENGTHS.items() if hasattr(entry, name)]
        if getattr(entry, "pattern", None):
            found.append(f"pattern `{entry.pattern}`")
    words = ", ".join(found)
    return f" {words[0].upper()}{words[1:]}." if words else ""


def _field_row(name: str, field: FieldInfo) -> str:
    default = "" if field.is_required() else f" Default `{json.dumps(field.default)}`."
    meaning = ((field.description or "") + limits(field) + default).strip()
    return f"| `{name}` | {type_name(field.annotation)} | {meaning} |"


def _fields(model: type[BaseModel], without: frozenset[str] = frozenset()) -> list[str]:
    rows = [_field_row(name, field) for name, field in model.model_fields.items() if name not in without]
    return ["| field | type | meaning |", "|---|---|---|", *rows, ""] if rows else []


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split())


def _message_section(title: str, model: type[BaseModel]) -> list[str]:
    return [f"### {title}", "", _summary(model), "", *_fields(model)]


def _needs(model: type[Request]) -> str:
    if issubclass(model, MovingRequest):
        return "Needs the lease."
    if issubclass(model, GuardedRequest):
        return "Needs the lease while somebody holds it; open to all clients otherwise."
    return "Open to all clients."


def _verb_section(verb: str, model: type[Request]) -> list[str]:
    example = EXAMPLES[verb]
    own = _fields(model, frozenset(Request.model_fields))
    return [
        f"### `{verb}`",
        "",
        f"{example.does} {STOP if verb == 'stop' else _needs(model)}",
        "",
        *own,
        "```json",
        json.dumps(example_request(verb)),
        json.dumps({"verb": verb, "mode": example.mode, "applied": example.applied}),
        "```",
        "",
    ]


def example_request(verb: str) -> dict[str, object]:
    """Return a request of a verb as a client sends it."""
    common: dict[str, object] = {"deadline_unix_ns": 1767225601000000000, "sequence": 7, "client": "ann"}
    if issubclass(VERBS[verb], MovingRequest):
        common["lease"] = TOKEN
    return common | dict(EXAMPLES[verb].fields)


def _transition_table() -> list[str]:
    rows = [f"| {before} | {event} | {after} |" for (before, event), after in TRANSITIONS.items()]
    early = [
        f"Until the first `ready`, `{event}` leads from {before} to {after}."
        for (before, event), after in BEFORE_READY.items()
    ]
    return ["| in | on | goes to |", "|---|---|---|", *rows, "", *early, ""]


def render() -> str:
    """Render the page as Markdown."""
    lines = [
        "# API",
        "",
        "Generated from the message definitions by `softarm bench reference`.",
        "",
        f"Keys begin with `{PREFIX}/<arm>/`. Payloads are JSON. Field names carry their unit.",
        "",
        "Connect with zenoh in mode `client` to `tcp/127.0.0.1:7447`, or to where the service listens, with",
        "multicast scouting off. `@v1` is a verbatim chunk: `softarm/**` does not match it; write",
        "`softarm/@v1/**`.",
        "",
        "| query | answer |",
        "|---|---|",
        "| `config` | the service's configuration with its defaults |",
        "| `specimen` | the specimen it runs on |",
        "| `surface` | [Surface](#surface): what `shape` moves; refused while the estimator is being built |",
        "| `schema` | the definitions of this page as JSON schemas |",
        "",
        "`alive` is a liveliness token: it is there while a service serves the arm.",
        "",
        "## Streams",
        "",
        "Publishing never waits: a slow subscriber misses messages. A new subscriber receives the last "
        "message.",
        "",
    ]
    for name, model in STREAMS.items():
        lines += _message_section(f"`{name}`", model)
    lines += [
        "### `shape`",
        "",
        "Not JSON: x, y, z [m] and von Mises stress [Pa] of every node of `surface`, little-endian float32,",
        "published while somebody listens.",
        "",
        "## Shared parts",
        "",
    ]
    for part in SHARED:
        lines += _message_section(part.__name__, part)
    lines += [
        "## Commands",
        "",
        "Query `command/<verb>` with the request as payload. There is one answer: `Applied` as a reply, or",
        "`Refused` as a reply error. Every request carries these fields and those of its verb; an unknown",
        "field is refused, and so is a request of more than 16 kB. Below each verb stand an example of a",
        "request and of its answer.",
        "",
        *_fields(Request),
    ]
    for verb, request in VERBS.items():
        lines += _verb_section(verb, request)
    for answer in (Applied, Refused):
        lines += _message_section(answer.__name__, answer)
    pressurised = ", ".join(mode for mode in Mode if mode in PRESSURISED)
    lines += [
        "## Modes",
        "",
        f"`state.mode` is one of {', '.join(Mode)}.",
        f"The valves may hold pressure in {pressurised}; in every other mode they are vented.",
        "",
        *_transition_table(),
    ]
    return "\n".join(lines).rstrip() + "\n"

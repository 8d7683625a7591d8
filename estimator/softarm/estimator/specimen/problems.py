"""Validation errors in the words of the person who wrote the file."""

import types
from collections.abc import Iterator
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from softarm.estimator.errors import InputError, suggest
from softarm.estimator.specimen.checks import Inconsistency

LIMITS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}
TYPES = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "tuple_type": "a list [...]",
    "list_type": "a list [...]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
}


class SpecimenError(InputError):
    """Several errors in one specimen, reported in one line.

    Args:
        file: The specimen's file.
        problems: The errors, each with the path of its field, what is wrong and its cure.
    """

    def __init__(self, file: str, problems: tuple[Inconsistency, ...]) -> None:
        listed = " ".join(
            f"({number}) {problem.field}: {problem.what}, {problem.cure};"
            for number, problem in enumerate(problems, 1)
        )
        super().__init__(file, f"{len(problems)} errors: {listed.rstrip(';')}", "correct them all")
        self.problems = problems


def describe_errors(file: str, error: ValidationError, model: type[BaseModel]) -> InputError:
    """Convert a validation error into one that names file, field, value, limit and cure."""
    entries = [dict(entry) for entry in error.errors()]
    problems = tuple(
        problem
        for entry in entries
        if not _follows_from_another(entry, entries)
        for problem in _problems(entry, model)
    )
    if len(problems) == 1:
        only = problems[0]
        return InputError(f"{file}: {only.field}" if only.field else file, only.what, only.cure)
    return SpecimenError(file, problems)


def _follows_from_another(entry: dict[str, Any], entries: list[dict[str, Any]]) -> bool:
    """Return whether a list counts as too short only because one of its members is wrong."""
    place = entry["loc"]
    return entry["type"] == "too_short" and any(
        other["loc"][: len(place)] == place for other in entries if len(other["loc"]) > len(place)
    )


def _problems(entry: dict[str, Any], model: type[BaseModel]) -> Iterator[Inconsistency]:
    kind, context, value = entry["type"], entry.get("ctx", {}), entry.get("input")
    owner, path = _locate(model, entry["loc"])
    if kind == "inconsistent":
        yield from context["problems"]
    elif kind == "extra_forbidden":
        yield Inconsistency(path, "unknown key", _nearest(str(entry["loc"][-1]), owner))
    elif kind == "missing":
        yield Inconsistency(path, "missing", f"add it: {_meaning(owner, str(entry['loc'][-1]))}")
    elif kind in LIMITS:
        key, words = LIMITS[kind]
        bound = f"{words} {context[key]:g}"
        unit = " in radians" if path.endswith("_rad") else ""
        yield Inconsistency(path, f"{value!r} is not {bound}", f"give a number{unit}, {bound}")
    elif kind in TYPES:
        yield Inconsistency(path, f"{value!r} is not {TYPES[kind]}", f"give {TYPES[kind]}")
    elif kind in ("literal_error", "union_tag_invalid"):
        yield from _choice(path, kind, context, value)
    elif kind in ("too_short", "too_long"):
        few = kind == "too_short"
        bound = f"at least {context['min_length']}" if few else f"at most {context['max_length']}"
        cure = "add the missing values" if few else "remove the surplus values"
        yield Inconsistency(path, f"holds {context['actual_length']} where it takes {bound}", cure)
    elif kind == "misfit":
        yield Inconsistency(path, context["what"], context["cure"])
    elif kind == "union_tag_not_found":
        yield Inconsistency(
            path, f"no {context['discriminator']}", f"add the key {context['discriminator']} first"
        )
    else:
        cure = str(context.get("cure", "correct it"))
        yield Inconsistency(path, f"{entry['msg']} (given: {_short(value)})", cure)


def _choice(path: str, kind: str, context: dict[str, Any], value: Any) -> Iterator[Inconsistency]:
    if kind == "union_tag_invalid":
        # pydantic puts the name in single quotes.
        path = f"{path}.{str(context['discriminator']).strip(chr(39))}"
        given, expected = str(context["tag"]), str(context["expected_tags"])
    else:
        given, expected = str(value), str(context["expected"])
    choices = [word.strip(" '") for word in expected.replace(" or ", ", ").split(",")]
    cure = suggest(given, choices, f"give one of {', '.join(choices)}")
    yield Inconsistency(path, f"'{given}' is not known", cure)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _nearest(key: str, owner: type[BaseModel] | None) -> str:
    keys = _keys(owner) if owner else []
    return suggest(key, keys, f"known here: {', '.join(keys)}", cutoff=0.4)


def _keys(owner: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in owner.model_fields.items()]


def _meaning(owner: type[BaseModel] | None, key: str) -> str:
    field = owner.model_fields.get(key) if owner else None
    text = (field.description or "") if field else ""
    # What stands behind the semicolon belongs to the page, such as where to find the tables.
    return " ".join(text.partition(";")[0].replace("``", "").rstrip(".").split()) or "it is needed"


def _locate(model: type[BaseModel], loc: tuple[Any, ...]) -> tuple[type[BaseModel] | None, str]:
    """Follow an error's location: the table that owns its last key, and its path as written in the file."""
    owner: type[BaseModel] | None = model
    annotation: Any = model
    path = ""
    for step in loc:
        tagged = _tagged(annotation, step)
        if tagged is not None:
            annotation = tagged
            continue
        if isinstance(step, int):
            path += f"[{step}]"
        else:
            path += f".{step}" if path else str(step)
        table = _table(annotation)
        if table is not None:
            owner = table
        annotation = _below(annotation, step)
    return owner, path


def _table(annotation: Any) -> type[BaseModel] | None:
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None


def _options(annotation: Any) -> list[Any]:
    if get_origin(annotation) in (Union, types.UnionType):
        return [option for option in get_args(annotation) if option is not type(None)]
    if get_origin(annotation) is not None and hasattr(annotation, "__metadata__"):
        return _options(get_args(annotation)[0])
    return [annotation]


def _tagged(annotation: Any, step: Any) -> type[BaseModel] | None:
    """Find the table of a union that a tag in the location stands for."""
    options = _options(annotation)
    if len(options) < 2:
        return None
    for option in options:
        table = _table(option)
        if table is None:
            continue
        for name in ("kind", "law"):
            field = table.model_fields.get(name)
            if field is not None and step in get_args(field.annotation):
                return table
    return None


def _below(annotation: Any, step: Any) -> Any:
    """Return the annotation of the item one step below."""
    for option in _options(annotation):
        table = _table(option)
        if table is not None:
            for name, field in table.model_fields.items():
                if step in (name, field.alias):
                    return field.annotation
        arguments = [argument for argument in get_args(option) if argument is not Ellipsis]
        if arguments and not isinstance(option, type):
            return arguments[-1]
    return None

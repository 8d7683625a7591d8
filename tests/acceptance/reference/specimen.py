"""The page that explains every key of a specimen, from its models."""

import types
from importlib import resources
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from softarm.estimator.specimen.body import Chamber, Clamp, Fibres, Marker, Section, Segment, SensorNoise
from softarm.estimator.specimen.calibration import (
    BendCalibration,
    Calibration,
    ChamberCalibration,
    FrameCalibration,
)
from softarm.estimator.specimen.entry import Value
from softarm.estimator.specimen.geometry import Block, Cylinder, MeshFile, QuadrantCylinder, SweptLobes
from softarm.estimator.specimen.material import Corotational, Gent, NeoHookean, Softening, Yeoh
from softarm.estimator.specimen.physics import EffectName, Parameter, Physics, Place
from softarm.estimator.specimen.specimen import Specimen

TABLES: tuple[tuple[str, type[BaseModel]], ...] = (
    ("The file", Specimen),
    ("`[geometry]`, kind `swept_lobes`", SweptLobes),
    ("`[geometry]`, kind `quadrant_cylinder`", QuadrantCylinder),
    ("`[geometry]`, kind `cylinder`", Cylinder),
    ("`[geometry]`, kind `block`", Block),
    ("`[geometry]`, kind `mesh_file`", MeshFile),
    ("`[materials.NAME]`, law `neo_hookean`", NeoHookean),
    ("`[materials.NAME]`, law `yeoh`", Yeoh),
    ("`[materials.NAME]`, law `gent`", Gent),
    ("`[materials.NAME]`, law `softening`", Softening),
    ("`[materials.NAME]`, law `corotational`", Corotational),
    ("`[[segments]]`", Segment),
    ("`[[sections]]`", Section),
    ("`[[chambers]]`", Chamber),
    ("`[fibres]`", Fibres),
    ("`[clamp]`", Clamp),
    ("`[[markers]]`", Marker),
    ("`[noise]`", SensorNoise),
    ("`[calibration]`", Calibration),
    ("`[[calibration.chambers]]`", ChamberCalibration),
    ("`[[calibration.bends]]`", BendCalibration),
    ("`[[calibration.frames]]`", FrameCalibration),
    ("A calibrated value", Value),
    ("`[[physics]]`", Physics),
    ("`[physics.where]`", Place),
    ("`[physics.parameters.NAME]`", Parameter),
)
EXAMPLES: dict[type[BaseModel], str] = {
    MeshFile: """\
[geometry]
kind = "mesh_file"
path = "arm.msh"
metres_per_unit = 0.001                             # the mesh was drawn in millimetres
regions = { upper = "silicone", tip = "end_plate" } # a segment and a section: their volumes' groups
chamber_surfaces = { 0 = "wall_a", 1 = "wall_b", 2 = "wall_c" }
clamp = "flange"
""",
}
"""Of tables that no shipped specimen has."""
UNITS = {
    "_kg_m3": "kg/m3",
    "_m_s2": "m/s2",
    "_n_m": "N/m",
    "_rad": "rad",
    "_pa": "Pa",
    "_kg": "kg",
    "_n": "N",
    "_m": "m",
}
INTRODUCTION = """# The specimen file

One TOML file describes one robot completely. `--specimen` takes the path of the file, or the name of a
shipped one: `sopra`, `single_segment`, `beam`. Every value is in SI units, and the end of a key names its
unit. The base frame has its origin at the clamp and its z axis along the arm at rest, from the base to the
tip; heights are measured along this axis. Pressures are gauge pressures. Quaternions are (w, x, y, z) and
describe the rotation from a section's axes to those of the base frame.

When the file is loaded, softarm reports all errors together: unknown keys, missing keys, values outside
their limits or apparently in another unit, and parts that do not fit together, each with its field, its value
and what to do. Calibration and diagnosis write their results into the same file, and the live estimator uses
them.

This page is generated from the classes that read the file by `softarm bench reference`.
"""


def render() -> str:
    """Write the page."""
    example = (resources.files("softarm.estimator.specimen") / "shipped" / "single_segment.toml").read_text(
        "utf-8"
    )
    parts = [INTRODUCTION, f"## Example\n\n```toml\n{example}```\n", "## Keys\n"]
    parts += [_table(title, model) for title, model in TABLES]
    effects = ", ".join(f"`{name}`" for name in get_args(EffectName))
    parts.append(f"### Effects\n\n`effect` is one of {effects}.\n")
    return "\n".join(parts)


def _table(title: str, model: type[BaseModel]) -> str:
    lines = [f"### {title}\n", _one_line(model.__doc__ or ""), ""]
    lines += ["| key | unit | value | default | meaning |", "|---|---|---|---|---|"]
    for name, field in model.model_fields.items():
        key = field.alias or name
        meaning = _one_line(field.description or "").replace("|", r"\|")
        lines.append(f"| `{key}` | {_unit(key)} | {_kind(field)} | {_default(field)} | {meaning} |")
    if model in EXAMPLES:
        lines += ["", f"```toml\n{EXAMPLES[model]}```"]
    return "\n".join(lines) + "\n"


def _one_line(text: str) -> str:
    paragraphs = text.split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs).strip().replace("``", "`")


def _unit(key: str) -> str:
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.default
    if value is PydanticUndefined or value is None or isinstance(value, BaseModel) or value in ((), ""):
        return ""
    if isinstance(value, tuple):
        return f"[{', '.join(map(str, value))}]"
    return f"`{value}`" if isinstance(value, str) else str(value).lower()


def _kind(field: FieldInfo) -> str:
    limits = [
        f"{word} {getattr(rule, key):g}"
        for rule in field.metadata
        for key, word in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most"))
        if getattr(rule, key, None) is not None
    ]
    return ", ".join([_words(field.annotation), *limits])


def _words(annotation: Any) -> str:
    """Describe what a value of some type is."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if hasattr(annotation, "__metadata__"):
        return _words(arguments[0])
    if origin is Literal:
        return (
            " or ".join(f"`{choice}`" for choice in arguments) if len(arguments) < 5 else "an effect's name"
        )
    if origin in (Union, types.UnionType):
        known = [option for option in arguments if option is not type(None)]
        return _words(known[0])
    if origin is tuple:
        inner = _words(arguments[0])
        return f"list of {inner}s" if Ellipsis in arguments else f"{len(arguments)} {inner}s"
    if origin is dict:
        return f"table of {_words(arguments[1])}s by name"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    return {float: "number", int: "whole number", str: "text", bool: "true or false"}[annotation]

"""``softarm specimen``: write the specimen of an arm from its measures."""

import math
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from softarm.cli.output import PATH, force_option, json_option, notify, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from softarm.estimator.specimen.measures import ArmMeasures, CylinderMeasures, LobeMeasures


@click.group(no_args_is_help=True)
def command() -> None:
    """Describe an arm: write its specimen from measures.

    Example: softarm specimen new --out my_arm.toml
    """


@command.command("new")
@click.option("--out", "-o", type=PATH, required=True, help="Specimen file to write (TOML).")
@force_option
@json_option
def new(out: Path, force: bool, as_json: bool) -> int:
    """Ask for the measures of an arm, check them, draw what was understood, and write a specimen.

    For hanging arms of one or more soft segments with a rigid section below each: either SoPrA's three
    tapering lobes, or a cylinder with any number of chambers. For any other body use a mesh file (kind
    mesh_file in docs/specimen.md). Measure lengths and radii in millimetres and masses in grams. A picture
    is written beside the specimen. Calibrate it next: softarm calibrate RECORDING --specimen FILE --out FILE.

    Example: softarm specimen new --out my_arm.toml
    """
    from softarm.cli.check import draw, specimen_tables
    from softarm.estimator.errors import InputError
    from softarm.estimator.files import require_free
    from softarm.estimator.specimen import load_specimen, require_free_specimen, save_specimen
    from softarm.estimator.specimen.measures import specimen_of_measures

    picture = out.with_suffix(".png")
    require_free_specimen(out, force=force)
    require_free(picture, force=force)
    while True:
        measures = _ask()
        try:
            specimen = specimen_of_measures(measures)
            break
        except InputError as error:
            if not sys.stdin.isatty():
                raise
            notify(f"softarm: {error}")
            notify("please enter the measures again")
    save_specimen(specimen, out)
    written = load_specimen(out)
    draw(written, picture)
    show(*specimen_tables(written), as_json=as_json)
    notify(f"wrote {out} and {picture}")
    return 0


class Quantity(NamedTuple):
    """What a measure may be: far more than soft arms need, but neither metres nor kilograms."""

    unit: str
    si: float
    least: float
    most: float

    def read(self, answer: str) -> float:
        """Read an answer, and return it in SI units.

        Raises:
            UsageError: It is no number that such a measure can have.
        """
        try:
            value = float(answer)
        except ValueError:
            value = math.nan
        if not self.least <= value <= self.most:
            span = f"{self.least:g} to {self.most:g} {self.unit}"
            raise click.UsageError(f"{answer!r} is not a number from {span}")
        # A product with a decimal fraction would write its rounding into the file.
        return round(self.si * value, 9)


LENGTH = Quantity("mm", 1e-3, 0.2, 2000.0)
MASS = Quantity("g", 1e-3, 0.2, 50_000.0)
MODULUS = Quantity("kPa", 1e3, 1.0, 1e7)
DENSITY = Quantity("kg/m3", 1.0, 50.0, 5000.0)
PRESSURE = Quantity("kPa", 1e3, 0.1, 1000.0)


def _number(text: str, default: float, quantity: Quantity) -> float:
    label = f"{text} [{quantity.unit}]"
    return float(click.prompt(label, default=str(default), value_proc=quantity.read, err=True))


def _name(answer: str) -> str:
    from softarm.estimator.specimen.entry import NAME

    if not re.match(NAME, answer):
        raise click.UsageError(f"{answer!r} is not a valid name: use letters, digits and _, a letter first")
    return answer


def _ask() -> "ArmMeasures":
    """Request every measure of the user, with those of SoPrA as defaults."""
    from softarm.estimator.specimen.measures import ArmMeasures, SegmentMeasures, names_of

    notify("Measures of the arm; Enter takes the value in brackets.")
    name = click.prompt("Name of the arm", default="my_arm", value_proc=_name, err=True)
    shape = click.prompt("Shape", default="lobes", type=click.Choice(("lobes", "cylinder")), err=True)
    count = click.prompt("Number of soft segments", default=2, type=click.IntRange(1, 6), err=True)
    base_m = _number("Length of the rigid base", 10.0, LENGTH)
    segment_names, section_names = names_of(count)
    segments = []
    for k, segment in enumerate(segment_names):
        below = section_names[k + 1]
        last = k == count - 1
        segments.append(
            SegmentMeasures(
                _number(f"Length of the soft segment {segment}", 120.0, LENGTH),
                _number(f"Mass of {segment}", 82.0 if last and count > 1 else 160.0, MASS),
                _number(f"Length of the rigid section {below}", 5.0 if last else 21.0, LENGTH),
                _number(f"Mass of the section {below}", 23.0 if last else 20.0, MASS),
            )
        )
    return ArmMeasures(
        name,
        base_m,
        tuple(segments),
        _ask_lobes(segment_names) if shape == "lobes" else _ask_cylinder(),
        _number("Young's modulus of the soft silicone (Shore 10A: 264)", 264.0, MODULUS),
        _number("Young's modulus of the rigid sections (Shore 30A: 1140)", 1140.0, MODULUS),
        _number("Density of the silicone", 1070.0, DENSITY),
        _number("Largest gauge pressure of a chamber", 65.0, PRESSURE),
        click.confirm("Are the chambers wound with fibres?", default=True, err=True),
    )


def _ask_lobes(segments: "Sequence[str]") -> "LobeMeasures":
    from softarm.estimator.specimen.measures import LobeMeasures

    ends = [f"Radius of a lobe at the lower end of {segment}" for segment in segments]
    radii = [_number("Radius of a lobe at the base", 17.5, LENGTH)]
    radii += [_number(text, 14.0, LENGTH) for text in ends[:-1]]
    radii += [_number(ends[-1], 9.9, LENGTH)]
    wall = _number("Thickness of the walls around a chamber", 2.0, LENGTH)
    return LobeMeasures(tuple(radii), wall, _number("Thickness between a chamber and the core", 2.0, LENGTH))


def _ask_cylinder() -> "CylinderMeasures":
    from softarm.estimator.specimen.measures import CylinderMeasures

    chambers = click.prompt(
        "Number of chambers of a segment", default=3, type=click.IntRange(2, 12), err=True
    )
    return CylinderMeasures(
        chambers,
        _number("Outer radius", 18.0, LENGTH),
        _number("Thickness of the outer wall and of those between chambers", 2.5, LENGTH),
        _number("Radius of the core between the chambers", 6.0, LENGTH),
    )

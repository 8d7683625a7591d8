"""``python -m softarm.fakes.plant``: recordings of the fake arm, written to folders."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import polars as pl

from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.fakes.plant.effects import ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS, Concealed, effect
from softarm.fakes.plant.from_specimen import arm_of, layout_of, name_of_drawing
from softarm.fakes.plant.generate import Laboratory, generate
from softarm.fakes.plant.manoeuvre import PlantManoeuvre, chain
from softarm.fakes.plant.manoeuvres import LIBRARY, SOPRA, ChamberLayout, path
from softarm.fakes.plant.mounts import MOUNTS
from softarm.fakes.plant.variants import variant
from softarm.fakes.plant.write import write

PLACES = ("segment", "chamber", "section", "sensor", "axis")


@click.group()
def main() -> None:
    """Make recordings of the fake arm."""


@main.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--manoeuvre", "names", multiple=True, default=("random_holds",), type=click.Choice(list(LIBRARY))
)
@click.option(
    "--mount",
    help="As the specimen has it when left out.",
    type=click.Choice(list(MOUNTS)),
)
@click.option("--effect", "effects", multiple=True, help="Such as 'tip_payload mass=0.02 section=tip'.")
@click.option("--variant", "arm", type=click.IntRange(0), help="Draw another arm of the same design.")
@click.option("--specimen", help="Specimen whose arm to simulate; SoPrA when left out.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the manoeuvre and of the noise."
)
@click.option("--truth", type=click.Path(path_type=Path), help="Folder for what is concealed.")
@click.option(
    "--commands",
    type=click.Path(path_type=Path),
    help="Table with columns t_s and pressure_cmd_K_pa, followed instead of the manoeuvres.",
)
def record(
    out: Path,
    names: tuple[str, ...],
    mount: str | None,
    effects: tuple[str, ...],
    arm: int | None,
    specimen: str | None,
    seed: int,
    truth: Path | None,
    commands: Path | None,
) -> None:
    """Record one run: the manoeuvres one after another, or pressures from a table.

    Example: python -m softarm.fakes.plant record runs/a --manoeuvre ramps --effect 'tip_payload mass=0.02'
    """
    rng = np.random.default_rng([seed, 30])
    laboratory, layout = _played(specimen, arm)
    parts = (
        [LIBRARY[name](rng, layout) for name in names] if commands is None else [_followed(commands, layout)]
    )
    if mount is not None:
        laboratory = laboratory.mounted(MOUNTS[mount])
    laboratory = replace(laboratory, concealed=tuple(map(parse_effect, effects)))
    what = "+".join(names) if commands is None else "commands"
    write(generate(laboratory, chain(what, *parts), seed), out, truth)


@main.command()
def effects() -> None:
    """List the effects with their parameters, places and ranges.

    Example: python -m softarm.fakes.plant effects
    """
    for name in (*ARM_EFFECTS, *INSTRUMENT_EFFECTS, *FOREIGN_EFFECTS):
        one = effect(name)
        ranges = (f"{n}={q.typical:g} {q.unit} ({q.low:g} to {q.high:g})" for n, q in one.quantities.items())
        foreign = " (foreign)" if name in FOREIGN_EFFECTS else ""
        click.echo(f"{name + foreign:32s} [{', '.join(one.places)}] {'; '.join(ranges)}")


def parse_effect(text: str) -> Concealed:
    """Read an effect from a command line: its name, then ``parameter=value`` and ``place=name``.

    Raises:
        InputError: A word is not of that form, or a value is not a number.
    """
    name, *words = text.split() or [""]
    where: dict[str, str | int] = {}
    numbers: dict[str, float] = {}
    for word in words:
        match = re.fullmatch(r"(\w+)=(\S+)", word)
        if not match:
            raise InputError(f"effect '{name}'", f"'{word}'", "write parameter=value")
        key, value = match.groups()
        if key in PLACES:
            where[key] = int(value) if key == "chamber" and value.isdigit() else value
            continue
        try:
            numbers[key] = float(value)
        except ValueError:
            raise InputError(
                f"effect '{name}'", f"'{word}' is not a number", "write parameter=value"
            ) from None
    return Concealed(name, where, numbers)


def _followed(table: Path, layout: ChamberLayout) -> PlantManoeuvre:
    """Read a manoeuvre from a table of commanded pressures, linear in between.

    Raises:
        InputError: The table cannot be read or lacks a column.
    """
    names = [f"pressure_cmd_{chamber}_pa" for chamber in range(layout.chambers)]
    try:
        columns = pl.read_csv(table)
        time, points = columns["t_s"].to_numpy(), columns.select(names).to_numpy()
    except (OSError, pl.exceptions.PolarsError) as error:
        cure = f"give a CSV with columns t_s, {names[0]} to {names[-1]}"
        raise InputError(str(table), f"cannot be read ({str(error).splitlines()[0]})", cure) from None
    return path("commands", points, time - time[0])


def _played(specimen: str | None, seed: int | None) -> tuple[Laboratory, ChamberLayout]:
    """Put SoPrA, another arm of its drawing, or the arm of a specimen in its laboratory."""
    if specimen is not None:
        described = load_specimen(specimen)
        drawn = arm_of(described, seed or 0)
        laboratory = Laboratory(drawn.arm, instruments=drawn.instruments, specimen=name_of_drawing(specimen))
        return laboratory, layout_of(described)
    if seed is None:
        return Laboratory(), SOPRA
    drawn = variant(seed)
    return Laboratory(drawn.arm, instruments=drawn.instruments), SOPRA


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        click.echo(f"fake arm: {error}", err=True)
        sys.exit(2)

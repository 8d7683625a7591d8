"""``softarm bench trial``: a blind trial, its arm and its concealed effects drawn by a seed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from softarm.cli.output import PATH
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.fakes.plant.effects import (
    ARM_EFFECTS,
    INSTRUMENT_EFFECTS,
    Concealed,
    ConcealedEffect,
    EffectParameter,
    effect,
)
from softarm.fakes.plant.from_specimen import drawing_of, layout_of, name_of_drawing
from softarm.fakes.plant.generate import Laboratory, generate
from softarm.fakes.plant.manoeuvre import PlantManoeuvre
from softarm.fakes.plant.manoeuvres import (
    SOPRA,
    ChamberLayout,
    co_contraction,
    directions,
    each_alone,
    growing_cycles,
    long_holds,
    one_of_each,
    pulled_steps,
    ramps,
    random_holds,
    random_pressures,
    staircase,
    steps,
    triangles,
)
from softarm.fakes.plant.mounts import MOUNTS
from softarm.fakes.plant.parameters import ArmParameters, sopra
from softarm.fakes.plant.shape import has_shape_of_sopra
from softarm.fakes.plant.variants import variant
from softarm.fakes.plant.write import write

Random = np.random.Generator

PAUSE = 20.0
FOREIGN = "random_law"
"""Drawn for a foreign trial: laws by name are known to whoever writes a diagnosis."""
KINDS = ("null", "single", "pair", "triple", "foreign")
AXES = tuple(str(angle) for angle in range(0, 360, 30))
NOMINAL_RUNS = (("random_holds", "hanging"), ("ramps", "hanging"), ("random_holds", "sideways"))
RUNS = (
    ("growing_cycles", "hanging"),
    ("random_holds", "hanging"),
    ("ramps", "hanging"),
    ("long_holds", "hanging"),
    ("each_alone", "hanging"),
    ("triangles", "hanging"),
    ("steps", "hanging"),
    ("staircase", "hanging"),
    ("co_contraction", "hanging"),
    ("pulled_steps", "hanging"),
    ("random_holds", "sideways"),
    ("each_alone", "sideways"),
    ("random_holds", "hanging"),
)
SHORT: dict[str, Callable[[Random, ChamberLayout], PlantManoeuvre]] = {
    "growing_cycles": lambda rng, on: growing_cycles(one_of_each(rng, on), cycle=5.0, on=on),
    "random_holds": lambda rng, on: random_holds(rng, seconds=40.0, on=on),
    "ramps": lambda rng, on: ramps(rng, durations=(4.0, 12.0), on=on),
    "long_holds": lambda rng, on: long_holds(rng, hold=30.0, count=1, on=on),
    "each_alone": lambda rng, on: each_alone(
        ramp=3.0, hold=1.0, highest=on.highest * rng.uniform(0.8, 1.1), on=on
    ),
    "triangles": lambda rng, on: triangles(one_of_each(rng, on), on=on),
    "steps": lambda rng, on: steps(rng, count=4, on=on),
    "staircase": lambda rng, on: staircase(rise=float(rng.uniform(1.2e3, 1.6e3)), hold=1.0, top=8e3, on=on),
    "co_contraction": lambda rng, on: co_contraction(
        ramp=3.0, highest=on.highest * rng.uniform(0.7, 0.9), on=on
    ),
    "pulled_steps": lambda rng, on: pulled_steps(
        count=6, ways=directions(2), pressures=random_pressures(rng, 0.4 * on.highest, on=on), on=on
    ),
}


@dataclass(frozen=True)
class TrialRun:
    """One recording of a trial.

    Args:
        name: Of its folder.
        laboratory: The arm, in its mount.
        manoeuvre: What is done.
        seed: Of its noise.
    """

    name: str
    laboratory: Laboratory
    manoeuvre: PlantManoeuvre
    seed: int


@dataclass(frozen=True)
class PlantTrial:
    """A blind trial.

    Args:
        seed: Which one.
        kind: One of ``KINDS``.
        concealed: The answer.
        runs: Recordings; those named ``nominal_...`` are of the arm before anything was concealed in it.
    """

    seed: int
    kind: str
    concealed: tuple[Concealed, ...]
    runs: tuple[TrialRun, ...]


@click.command()
@click.argument("out", type=PATH)
@click.option("--seed", required=True, type=click.IntRange(0), help="Which trial.")
@click.option("--kind", default="single", show_default=True, type=click.Choice(KINDS))
@click.option("--only", multiple=True, help="Draw from these effects only.")
@click.option("--background", default=1.0, show_default=True, help="Scale of what every arm has anyway.")
@click.option("--specimen", default="sopra", show_default=True, help="Drawing of the arm.")
@click.option("--truth", required=True, type=PATH, help="Folder for the answer.")
def command(
    out: Path, seed: int, kind: str, only: tuple[str, ...], background: float, specimen: str, truth: Path
) -> int:
    """Record a blind trial: a fake arm before and after something was concealed in it.

    Example: softarm bench trial trials/7 --seed 7 --kind pair --truth answers/7
    """
    record_trial(draw(seed, kind, background, only, specimen), out, truth)
    return 0


def record_trial(trial: PlantTrial, out: Path, truth: Path) -> None:
    """Record the runs of a trial, and write what is concealed in them to another folder."""
    for run in trial.runs:
        write(generate(run.laboratory, run.manoeuvre, run.seed), out / run.name, truth / run.name)


def draw(
    seed: int, kind: str, background: float = 1.0, only: tuple[str, ...] = (), specimen: str = "sopra"
) -> PlantTrial:
    """Draw a trial.

    Args:
        seed: Which one.
        kind: ``null`` for nothing concealed, ``single``, ``pair`` or ``triple`` for effects of the
            vocabulary, ``foreign`` for one outside it.
        background: Scale of what every arm has of creep, hysteresis and the like.
        only: Names to draw from; all of the kind when left out.
        specimen: Drawing of the arm: the name of a shipped specimen, or a file.

    Raises:
        InputError: The kind or a name is unknown, or the drawing cannot be read or simulated.
    """
    if kind not in KINDS:
        raise InputError("kind", f"'{kind}'", f"one of {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, 10])
    names = _names(rng, kind, only)
    drawing = load_specimen(specimen)
    plain, layout = (
        (sopra(), SOPRA) if has_shape_of_sopra(drawing) else (drawing_of(drawing), layout_of(drawing))
    )
    concealed = tuple(_drawn_effect(rng, effect(name), plain) for name in names)
    drawn = variant(seed, background=background, plain=plain)
    unchanged = Laboratory(drawn.arm, instruments=drawn.instruments, specimen=name_of_drawing(specimen))
    changed = replace(unchanged, concealed=concealed)
    runs = (
        *_runs("nominal", unchanged, layout, NOMINAL_RUNS, seed),
        *_runs("run", changed, layout, RUNS, seed),
    )
    return PlantTrial(seed, kind, concealed, runs)


def _drawn_effect(rng: Random, definition: ConcealedEffect, arm: ArmParameters) -> Concealed:
    """Draw the place and the size of one effect; sizes of one sign are even on a logarithmic scale."""
    choices: dict[str, tuple[str | int, ...]] = {
        "segment": tuple(segment.name for segment in arm.segments),
        "chamber": tuple(range(arm.chambers)),
        "section": arm.sections[-1:],
        "axis": AXES,
        "sensor": tuple(f"frame_{section}" for section in arm.sections[1:]),
    }
    places = sorted(definition.places, key="sensor".__eq__)  # sensors last, as a seed has always drawn
    where = {place: _choose(rng, choices[place]) for place in places}
    numbers = {name: _size(rng, quantity) for name, quantity in definition.quantities.items()}
    return Concealed(definition.name, where, numbers)


def _names(rng: Random, kind: str, only: tuple[str, ...]) -> tuple[str, ...]:
    """Draw the names of the effects, without repeats."""
    names = [FOREIGN] if kind == "foreign" else [*ARM_EFFECTS, *INSTRUMENT_EFFECTS]
    pool = sorted(only or names)
    count = {"null": 0, "single": 1, "pair": 2, "triple": 3, "foreign": 1}[kind]
    if count > len(pool):
        raise InputError("only", f"{len(pool)} names for {count} effects", "give more names")
    return tuple(str(name) for name in rng.choice(pool, count, replace=False))


def _choose(rng: Random, choices: tuple[str | int, ...]) -> str | int:
    """Draw one of some choices."""
    return choices[int(rng.integers(len(choices)))]


def _size(rng: Random, quantity: EffectParameter) -> float:
    """Draw a parameter; one that may be negative is at least a quarter of its range's end away from zero."""
    low, high = quantity.low, quantity.high
    if low == high or low * high < 0.0:
        side = low if rng.random() < 0.5 else high
        return float(side * rng.uniform(0.25, 1.0)) if low != high else low
    if low == 0.0:
        return float(rng.uniform(low, high))
    return float(np.sign(low) * np.exp(rng.uniform(*np.sort(np.log(np.abs([low, high]))))))


def _runs(
    prefix: str, laboratory: Laboratory, layout: ChamberLayout, plan: tuple[tuple[str, str], ...], seed: int
) -> tuple[TrialRun, ...]:
    """Lay out the runs of an arm, one session with pauses."""
    runs, clock = [], 0.0
    for number, (name, mount) in enumerate(plan):
        stream = [seed, number, len(plan)]
        manoeuvre = SHORT[name](np.random.default_rng(stream), layout)
        runs.append(
            TrialRun(
                f"{prefix}_{number:02d}_{name}_{mount}",
                replace(laboratory.mounted(MOUNTS[mount]), session_start=clock),
                manoeuvre,
                int(np.random.default_rng([*stream, 1]).integers(2**31)),
            )
        )
        clock += manoeuvre.duration + PAUSE
    return tuple(runs)

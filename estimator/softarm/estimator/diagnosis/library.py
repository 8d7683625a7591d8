"""The hypotheses of a diagnosis: every effect at every place, with the directions that stand for it.

A direction is the change of the prediction per unit of an amplitude at fixed shape parameters. An effect
without shape parameters has one direction per amplitude; one with shapes has a set for each of several
values.
Effects that are no small change of anything, such as a saturation, count as present with the amplitude 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.stage import Stage, superposes
from softarm.estimator.effects import EFFECTS, Effect, Spot, World
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.specimen.physics import EffectName, Place

RUNAWAY = 10.0
"""Change of a prediction [rad, m] by a typical effect that cannot be meant."""
SMALL = 0.5
"""Share of the typical amplitude at which the change is taken, so that it stays near linear."""


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place.

    Args:
        place: Where.
    """

    effect: Effect
    place: Place

    @property
    def name(self) -> EffectName:
        """Name of the effect."""
        return self.effect.name

    def placed(self, world: World, theta: Floats) -> PlacedEffect:
        """Return the effect with its parameters, shape (parameters,)."""
        return PlacedEffect(self.effect, Spot(world, self.place), theta)


@dataclass(frozen=True)
class Direction:
    """One column: a hypothesis with one amplitude raised.

    Args:
        hypothesis: Number of the hypothesis.
        shape: Number of the set of shape parameters.
        parameter: Number of the amplitude; -1 where the effect is simply present.
        theta: Parameters at which the change is taken, shape (parameters,).
        size: Amplitude at which it is taken.
        typical: Amplitude that a coefficient of 1 stands for.
    """

    hypothesis: int
    shape: int
    parameter: int
    theta: Floats
    size: float
    typical: float


@dataclass(frozen=True)
class Library:
    """All hypotheses and their directions.

    Args:
        directions: The directions, those of one hypothesis and shape together.
    """

    hypotheses: tuple[Hypothesis, ...]
    directions: tuple[Direction, ...]

    def index_of(self, name: EffectName, place: Place) -> int | None:
        """Return the number of an effect at a place; ``None`` where it is no hypothesis."""
        numbers = (k for k, h in enumerate(self.hypotheses) if (h.name, h.place) == (name, place))
        return next(numbers, None)

    def groups(self) -> list[tuple[int, int, list[int]]]:
        """List hypothesis, shape and the columns that belong to them."""
        groups: dict[tuple[int, int], list[int]] = {}
        for column, direction in enumerate(self.directions):
            groups.setdefault((direction.hypothesis, direction.shape), []).append(column)
        return [(hypothesis, shape, columns) for (hypothesis, shape), columns in groups.items()]


def build_library(
    world: World,
    pressures: Floats,
    names: Sequence[EffectName] | None = None,
    *,
    compared: bool = True,
    drawn: bool = False,
    measured: bool = False,
) -> Library:
    """List the hypotheses for an arm.

    Args:
        world: What effects may refer to.
        pressures: All recorded pressures [Pa], shape (samples, chambers); chambers that were never driven are
            left out.
        names: Effects to try; all when left out.
        compared: Whether recordings show the arm in its known state.
        drawn: Whether nothing but a drawing is the reference: what its calibration has to find is left out.
        measured: Whether no pressure is a set-point: what a valve makes of these is then known.
    """
    highest = np.nanmax(pressures, axis=0, initial=0.0)
    hypotheses: list[Hypothesis] = []
    directions: list[Direction] = []
    for name, known in EFFECTS.items():
        effect = known if compared else known.against_drawing()
        if measured and effect.shown_by_pressures:
            continue
        if not effect.by_fit or (names is not None and name not in names):
            continue
        for place in effect.places(world):
            if not _driven(effect, place, world, highest) or (drawn and _calibrated(effect, place)):
                continue
            number = len(hypotheses)
            hypotheses.append(Hypothesis(effect, place))
            directions += _directions(number, effect, place, world, highest)
    return Library(tuple(hypotheses), tuple(directions))


def _calibrated(effect: Effect, place: Place) -> bool:
    """Return whether an effect changes a segment's modulus or area, which a drawing does not determine."""
    return "uniform_gain" in effect.equivalence and place.chamber is None


def library_columns(stage: Stage, library: Library) -> Floats:
    """Return the change of a session's predictions by a typical amplitude of each direction.

    Returns:
        Shape (samples, rows, directions).
    """
    columns = np.zeros((stage.session.samples, stage.suite.size, len(library.directions)))
    together: dict[str, list[tuple[int, PlacedEffect]]] = {}
    for number, direction in enumerate(library.directions):
        hypothesis = library.hypotheses[direction.hypothesis]
        sensor = hypothesis.place.sensor
        if sensor is not None and sensor not in stage.world.sensors:
            continue
        placed = hypothesis.placed(stage.world, direction.theta)
        if superposes(placed):
            together.setdefault(placed.field, []).append((number, placed))
        else:
            columns[..., number] = stage.change([placed])
    for listed in together.values():
        numbers, effects = zip(*listed, strict=True)
        columns[..., list(numbers)] = stage.first_order_of_many(effects)
    columns *= [direction.typical / direction.size for direction in library.directions]
    # A direction that runs away somewhere has no linear meaning there.
    return np.where(np.abs(columns) < RUNAWAY, np.nan_to_num(columns, posinf=0.0, neginf=0.0), 0.0)


def _driven(effect: Effect, place: Place, world: World, highest: Floats) -> bool:
    if not effect.driven:
        return True
    spot = Spot(world, place)
    return bool((highest[spot.chambers] > 1000.0).any())


def _directions(number: int, effect: Effect, place: Place, world: World, highest: Floats) -> list[Direction]:
    if effect.presences is not None:
        present = effect.presences(Spot(world, place), highest)
        return [Direction(number, shape, -1, theta, 1.0, 1.0) for shape, theta in enumerate(present)]
    amplitudes = [k for k, p in enumerate(effect.parameters) if p.role == "amplitude"]
    shapes = [k for k, p in enumerate(effect.parameters) if p.role == "shape"]
    directions = []
    for shape, values in enumerate(effect.shapes):
        for k in amplitudes:
            theta = effect.neutral
            theta[shapes] = values
            typical = abs(effect.parameters[k].typical)
            theta[k] = SMALL * typical
            directions.append(Direction(number, shape, k, theta, SMALL * typical, typical))
    return directions

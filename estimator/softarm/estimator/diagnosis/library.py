"""The hypotheses of a diagnosis: every effect at every place, with the directions that stand for it.

A direction is the change of the prediction per unit of an amplitude at fixed shape parameters. An effect
without shape parameters has one direction per amplitude; one with shapes has a set for each of several
values.
Effects that are no small change of anything, such as a saturation, count as present with the amplitude 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.effects import EFFECTS, Effect, Spot, World
from softarm.estimator.effects.augmented import PlacedEffect
from softarm.estimator.specimen.physics import EffectName, Place

Floats = NDArray[np.float64]

AROUND = tuple(np.radians(np.arange(-180.0, 180.0, 45.0)).tolist())
"""Directions in the cross-section in which what acts on one side is tried [rad]."""
SHAPES: dict[str, tuple[tuple[float, ...], ...]] = {
    "viscoelastic_creep": ((0.7,), (2.0,), (6.0,), (20.0,), (60.0,)),
    "hysteresis": ((0.03,), (0.1,), (0.3,)),
    "mullins_softening": ((0.15,), (0.5,)),
    "material_softening": ((1.0,), (2.0,)),
    "line_leak": ((0.3,), (3.0,), (30.0,)),
    "thermal_drift": ((150.0,), (600.0,), (3000.0,)),
    "base_tilt": ((0.0,), (1.0,)),
    "tether_stiffness": tuple((slack, angle) for slack in (0.0, 0.02, 0.04) for angle in AROUND),
    "local_stiffness_defect": tuple((float(angle),) for angle in np.radians(np.arange(-150.0, 181.0, 60.0))),
    "contact_obstacle": tuple((distance, angle) for distance in (0.01, 0.03, 0.05, 0.07) for angle in AROUND),
}
"""Values of the shape parameters, in their order, at which an effect is tried."""
CUT = (0.9, 0.75, 0.6)
"""Shares of the highest recorded pressure at which a saturation is tried."""
APART = ("sensor_stuck",)
"""Found by looking at the readings themselves, not by a fit."""
RUNAWAY = 10.0
"""Change of a prediction [rad, m] by a typical effect that cannot be meant."""
SMALL = 0.5
"""Share of the typical amplitude at which the change is taken, so that it stays near linear."""


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place.

    Args:
        effect: The effect.
        place: Where.
    """

    effect: Effect
    place: Place

    @property
    def name(self) -> EffectName:
        """Name of the effect."""
        return self.effect.name

    def placed(self, world: World, theta: Floats) -> PlacedEffect:
        """Give the effect with its parameters, shape (parameters,)."""
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
        hypotheses: The hypotheses.
        directions: The directions, those of one hypothesis and shape together.
    """

    hypotheses: tuple[Hypothesis, ...]
    directions: tuple[Direction, ...]

    def groups(self) -> list[tuple[int, int, list[int]]]:
        """List hypothesis, shape and the columns that belong to them."""
        found: dict[tuple[int, int], list[int]] = {}
        for column, direction in enumerate(self.directions):
            found.setdefault((direction.hypothesis, direction.shape), []).append(column)
        return [(hypothesis, shape, columns) for (hypothesis, shape), columns in found.items()]


def build_library(world: World, pressures: Floats, names: Sequence[EffectName] | None = None) -> Library:
    """List the hypotheses for an arm.

    Args:
        world: What effects may refer to.
        pressures: All recorded pressures [Pa], shape (samples, chambers); chambers that were never driven are
            left out.
        names: Effects to try; all when left out.
    """
    highest = np.nanmax(pressures, axis=0, initial=0.0)
    hypotheses: list[Hypothesis] = []
    directions: list[Direction] = []
    for name, effect in EFFECTS.items():
        if name in APART or (names is not None and name not in names):
            continue
        for place in effect.places(world):
            if not _driven(effect, place, world, highest):
                continue
            number = len(hypotheses)
            hypotheses.append(Hypothesis(effect, place))
            directions += _directions(number, effect, place, world, highest)
    return Library(tuple(hypotheses), tuple(directions))


def library_columns(stage: Stage, library: Library) -> Floats:
    """Give the change of a session's predictions by a typical amplitude of each direction.

    Returns:
        Shape (samples, rows, directions).
    """
    columns = np.zeros((stage.session.samples, stage.suite.size, len(library.directions)))
    for number, direction in enumerate(library.directions):
        hypothesis = library.hypotheses[direction.hypothesis]
        sensor = hypothesis.place.sensor
        if sensor is not None and sensor not in stage.world.sensors:
            continue
        placed = hypothesis.placed(stage.world, direction.theta)
        columns[..., number] = stage.change([placed]) * (direction.typical / direction.size)
    # A direction that runs away somewhere has no linear meaning there.
    return np.where(np.abs(columns) < RUNAWAY, np.nan_to_num(columns, posinf=0.0, neginf=0.0), 0.0)


def _driven(effect: Effect, place: Place, world: World, highest: Floats) -> bool:
    if effect.hook not in ("command", "pressure") and effect.name != "fibre_twist":
        return True
    spot = Spot(world, place)
    return bool((highest[spot.chambers] > 1000.0).any())


def _directions(number: int, effect: Effect, place: Place, world: World, highest: Floats) -> list[Direction]:
    if effect.name == "pressure_saturation":
        return _saturations(number, place, world, highest)
    amplitudes = [k for k, p in enumerate(effect.parameters) if p.role == "amplitude"]
    shapes = [k for k, p in enumerate(effect.parameters) if p.role == "shape"]
    found = []
    for shape, values in enumerate(SHAPES.get(effect.name, ((),))):
        for k in amplitudes:
            theta = effect.neutral
            theta[shapes] = values
            typical = abs(effect.parameters[k].typical)
            theta[k] = SMALL * typical
            found.append(Direction(number, shape, k, theta, SMALL * typical, typical))
    return found


def _saturations(number: int, place: Place, world: World, highest: Floats) -> list[Direction]:
    spot = Spot(world, place)
    own = highest[spot.chambers]
    limits = world.pressure_limits[spot.chambers]
    found = []
    for shape, share in enumerate(CUT):
        shortfall = float((limits - share * own).max())
        if shortfall > 0.0:
            found.append(Direction(number, shape, -1, np.array([shortfall]), 1.0, 1.0))
    return found

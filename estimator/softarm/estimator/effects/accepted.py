"""The effects that a specimen file lists as parts of its model."""

import numpy as np

from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.effect import Effect
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.effects.world import Spot, World
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import Parameter, Physics


def accepted_physics(specimen: Specimen, world: World) -> tuple[PlacedEffect, ...]:
    """Return the effects of a specimen's ``[[physics]]`` in their order, ready to act.

    Raises:
        InputError: If an effect has no physics, or lacks or exceeds its parameters or their bounds.
    """
    return tuple(_placed(entry, world) for entry in specimen.physics)


def physics_entry(placed: PlacedEffect, stds: tuple[float, ...], recordings: tuple[str, ...] = ()) -> Physics:
    """Write an effect down for a specimen file, with the standard deviation of each parameter."""
    values = zip(placed.effect.parameters, placed.theta.tolist(), stds, strict=True)
    return Physics(
        effect=placed.effect.name,
        where=placed.spot.place,
        parameters={
            p.name: Parameter(value=value, std=std, unit=placed.effect.unit(p, placed.spot.place))
            for p, value, std in values
        },
        recordings=recordings,
    )


def _placed(entry: Physics, world: World) -> PlacedEffect:
    effect = EFFECTS.get(entry.effect)
    if effect is None:
        cure = "remove it, or name one of the library"
        raise InputError(f"physics.{entry.effect}", "the model has no equation for this effect", cure)
    names = {parameter.name for parameter in effect.parameters}
    if set(entry.parameters) != names:
        what = f"parameters {', '.join(sorted(entry.parameters)) or 'none'}"
        raise InputError(f"physics.{entry.effect}", what, f"give exactly {', '.join(sorted(names))}")
    return PlacedEffect(effect, Spot(world, entry.where), np.array(_values(effect, entry)))


def _values(effect: Effect, entry: Physics) -> list[float]:
    """Return the values in the order of the effect's parameters, each in its unit and bounds."""
    values = []
    for parameter in effect.parameters:
        given = entry.parameters[parameter.name]
        where = f"physics.{entry.effect}.{parameter.name}"
        unit = effect.unit(parameter, entry.where)
        if given.unit != unit:
            raise InputError(where, f"its unit is {given.unit!r}", f"give it in {unit!r}")
        if not parameter.lower <= given.value <= parameter.upper:
            allowed = f"give {parameter.lower:g} to {parameter.upper:g} {unit}"
            raise InputError(where, f"{given.value:g} is out of bounds", allowed)
        if parameter.choices and given.value not in parameter.choices:
            laws = " or ".join(f"{choice:g}" for choice in parameter.choices)
            raise InputError(where, f"{given.value:g} stands for no law", f"give {laws}")
        values.append(given.value)
    return values

"""All effects by name, and how they are put into an arm or in front of a signal."""

from types import ModuleType
from typing import TypeVar

from softarm.estimator.errors import InputError
from softarm.fakes.plant.effects import chambers, foreign, rubber, sensors, surroundings, valves
from softarm.fakes.plant.effects.effect import ArmEffect, Concealed, ConcealedEffect, Filter, InstrumentEffect
from softarm.fakes.plant.parameters import ArmParameters

Kind = TypeVar("Kind", bound=ConcealedEffect)


def _effects(kind: type[Kind], *modules: ModuleType) -> dict[str, Kind]:
    """Collect the effects of modules by name, in the order of the alphabet, by which trials draw them."""
    effects = [one for module in modules for one in vars(module).values() if isinstance(one, kind)]
    return {one.name: one for one in sorted(effects, key=lambda one: one.name)}


ARM_EFFECTS = _effects(ArmEffect, rubber, chambers, surroundings)
FOREIGN_EFFECTS = _effects(ArmEffect, foreign)
INSTRUMENT_EFFECTS = _effects(InstrumentEffect, valves, sensors)


def effect(name: str) -> ConcealedEffect:
    """Find an effect by its name.

    Raises:
        InputError: There is none.
    """
    for effects in (ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS):
        if name in effects:
            return effects[name]
    names = ", ".join((*ARM_EFFECTS, *INSTRUMENT_EFFECTS, *FOREIGN_EFFECTS))
    raise InputError(f"effect '{name}'", "unknown", f"one of {names}")


def apply(arm: ArmParameters, concealed: tuple[Concealed, ...]) -> ArmParameters:
    """Put effects into an arm, one after another.

    Raises:
        InputError: One of them does not live in the arm, or its parameters or place do not fit.
    """
    for one in concealed:
        definition = effect(one.name)
        if not isinstance(definition, ArmEffect):
            raise InputError(
                f"effect '{one.name}'", "acts in an instrument", "conceal it in the signal's filter"
            )
        arm = definition.change(arm, one.where, definition.numbers(one))
    return arm


def arm_effects(concealed: tuple[Concealed, ...]) -> tuple[Concealed, ...]:
    """Choose those that live in the arm."""
    return tuple(one for one in concealed if isinstance(effect(one.name), ArmEffect))


def filters(concealed: tuple[Concealed, ...], signal: str, sensor: str | None = None) -> tuple[Filter, ...]:
    """Make the filters of one signal.

    Args:
        concealed: Effects, those of the arm included.
        signal: ``valve``, ``pose``, ``bend`` or ``gauge``.
        sensor: Name of the sensor, such as ``frame_tip``; an effect without a sensor acts on all of its kind.
    """
    made = []
    for one in concealed:
        definition = effect(one.name)
        if isinstance(definition, InstrumentEffect) and signal in definition.signals:
            numbers = definition.numbers(one)
            if one.where.get("sensor") in (None, sensor):
                made.append(definition.make(signal, one.where, numbers))
    return tuple(made)

"""All effects by name, and how they are put into an arm or in front of a signal."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

from softarm.estimator.errors import InputError
from softarm.fakes.plant.effects import arm as of_arm
from softarm.fakes.plant.effects import foreign, instrument
from softarm.fakes.plant.effects.effect import ArmEffect, Concealed, ConcealedEffect, Filter, InstrumentEffect
from softarm.fakes.plant.parameters import ArmParameters


def _effects_in(package: ModuleType) -> list[ConcealedEffect]:
    """Collect the effects of a package: an effect is one file with an ``EFFECT``."""
    names = sorted(module.name for module in iter_modules(package.__path__))
    modules = [import_module(f"{package.__name__}.{name}") for name in names]
    return [module.EFFECT for module in modules if hasattr(module, "EFFECT")]


def _arm_effects_in(package: ModuleType) -> dict[str, ArmEffect]:
    return {one.name: one for one in _effects_in(package) if isinstance(one, ArmEffect)}


ARM_EFFECTS = _arm_effects_in(of_arm)
FOREIGN_EFFECTS = _arm_effects_in(foreign)
INSTRUMENT_EFFECTS = {one.name: one for one in _effects_in(instrument) if isinstance(one, InstrumentEffect)}


def effect(name: str) -> ConcealedEffect:
    """Find an effect by its name.

    Raises:
        InputError: There is none.
    """
    for effects in (ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS):
        if name in effects:
            return effects[name]
    known = ", ".join((*ARM_EFFECTS, *INSTRUMENT_EFFECTS, *FOREIGN_EFFECTS))
    raise InputError(f"effect '{name}'", "unknown", f"one of {known}")


def apply(arm: ArmParameters, concealed: tuple[Concealed, ...]) -> ArmParameters:
    """Put effects into an arm, one after another.

    Raises:
        InputError: One of them does not live in the arm, or its parameters or place do not fit.
    """
    for one in concealed:
        known = effect(one.name)
        if not isinstance(known, ArmEffect):
            raise InputError(
                f"effect '{one.name}'", "acts in an instrument", "conceal it in the signal's filter"
            )
        arm = known.change(arm, one.where, known.numbers(one))
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
        known = effect(one.name)
        if isinstance(known, InstrumentEffect) and signal in known.signals:
            numbers = known.numbers(one)
            if one.where.get("sensor") in (None, sensor):
                made.append(known.make(signal, one.where, numbers))
    return tuple(made)

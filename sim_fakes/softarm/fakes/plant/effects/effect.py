"""What a concealed effect is: a name, a place, a few numbers, and a change of the arm or of a signal."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.fakes.plant.parameters import ArmParameters

Where = Mapping[str, str | int]
Numbers = Mapping[str, float]


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Args:
        unit: SI unit, empty for a pure number.
        typical: Value when none is given.
        low: Smallest value of a trial, hardly visible in a recording.
        high: Largest value of a trial.
    """

    unit: str
    typical: float
    low: float
    high: float


@dataclass(frozen=True)
class Concealed:
    """One effect as it is concealed in an arm or an instrument.

    Args:
        name: Of the effect.
        where: Its place: ``segment``, ``chamber``, ``section``, ``sensor`` or ``axis``.
        parameters: Values that differ from the typical ones; ``strength`` names the principal one.
    """

    name: str
    where: Where = field(default_factory=dict)
    parameters: Numbers = field(default_factory=dict)


class Filter(Protocol):
    """A pure filter of one signal with a memory of its own."""

    def update(self, time: float, value: Floats) -> Floats:
        """Pass one reading through.

        Args:
            time: Of the reading [s], not falling.
            value: Pressures [Pa], a pose (position [m] and quaternion), a bend [rad] or a pull [N].
        """


@dataclass(frozen=True)
class ConcealedEffect:
    """What every effect states of itself.

    Args:
        name: In the vocabulary of the diagnosis, or outside it for a foreign effect.
        principal: Parameter that is its strength; at zero the effect is absent.
        quantities: All parameters by name.
        places: Kind of place it may have, such as ``chamber``; empty when it has none.
    """

    name: str
    principal: str
    quantities: Mapping[str, EffectParameter]
    places: tuple[str, ...] = ()

    def numbers(self, concealed: Concealed) -> dict[str, float]:
        """Complete the parameters by the typical ones.

        Raises:
            InputError: A parameter or a kind of place is unknown, or a value is not finite.
        """
        stated = {
            self.principal if name == "strength" else name: v for name, v in concealed.parameters.items()
        }
        where = f"effect '{self.name}'"
        for name in stated:
            if name not in self.quantities:
                raise InputError(where, f"no parameter '{name}'", f"one of {', '.join(self.quantities)}")
            if not math.isfinite(stated[name]):
                raise InputError(where, f"{name} = {stated[name]}", "give a finite number")
        for place in concealed.where:
            if place not in self.places:
                raise InputError(
                    where, f"cannot be placed by '{place}'", f"one of {', '.join(self.places) or 'none'}"
                )
        return {name: stated.get(name, quantity.typical) for name, quantity in self.quantities.items()}


@dataclass(frozen=True)
class ArmEffect(ConcealedEffect):
    """An effect inside the arm: a change of its parameters, none at zero strength."""

    change: Callable[[ArmParameters, Where, Numbers], ArmParameters] = field(kw_only=True)


@dataclass(frozen=True)
class InstrumentEffect(ConcealedEffect):
    """An effect of the valves or of a sensor: a filter of its signal, the identity at zero strength.

    Args:
        signals: Signals it can act on: ``valve``, ``pressure``, ``pose``, ``bend``, ``gauge``.
        make: Makes the filter for one signal from the kind of signal, the place and the numbers.
    """

    signals: tuple[str, ...] = field(kw_only=True)
    make: Callable[[str, Where, Numbers], Filter] = field(kw_only=True)


def arm_effect(
    *, places: tuple[str, ...] = (), **quantities: EffectParameter
) -> Callable[[Callable[[ArmParameters, Where, Numbers], ArmParameters]], ArmEffect]:
    """Make an effect of the function that changes the arm, under the function's name.

    Args:
        places: Kinds of place it may have.
        quantities: Its parameters, the principal one first.
    """
    return lambda change: ArmEffect(
        change.__name__, next(iter(quantities)), quantities, places, change=change
    )


def instrument_effect(
    signals: tuple[str, ...], *, places: tuple[str, ...] = (), **quantities: EffectParameter
) -> Callable[[Callable[[str, Where, Numbers], Filter]], InstrumentEffect]:
    """Make an effect of the function that makes its filter, under the function's name.

    Args:
        signals: Signals it can act on.
        places: Kinds of place it may have.
        quantities: Its parameters, the principal one first.
    """
    return lambda make: InstrumentEffect(
        make.__name__, next(iter(quantities)), quantities, places, signals=signals, make=make
    )

"""Concealed effects of valves and sensors: filters between the truth and what an instrument sees of it."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.fakes.plant.effects import INSTRUMENT_EFFECTS, Concealed, Filter, filters

SignalFilter = Callable[[str, str | None, float, Floats], Floats]
"""Passes a value of a signal of a sensor at a time through what is concealed in it."""


def unmodified(signal: str, sensor: str | None, time: float, value: Floats) -> Floats:  # noqa: ARG001
    """Return a signal as it is."""
    return value


class ConcealedSignals:
    """The concealed effects that are on, and the filters they make.

    Signals: ``valve`` and ``pressure`` [Pa] in chamber order, ``pose`` (position [m] and quaternion) of
    ``frame_<section>``, ``bend`` [rad] of ``bend_<section>``, ``gauge`` [N] of ``gauge_cord``.
    """

    def __init__(self) -> None:
        self._concealed: dict[str, Concealed] = {}
        self._chains: dict[tuple[str, str | None], tuple[Filter, ...]] = {}

    def switch(self, effect: str, value: object) -> None:
        """Set one effect.

        Args:
            effect: Its name, one of ``INSTRUMENT_EFFECTS``.
            value: None or 0 for off, a number for its strength everywhere, or a table of ``where`` and
                parameters.

        Raises:
            InputError: The value does not fit the effect.
        """
        chosen = _read(effect, value)
        if chosen is None:
            self._concealed.pop(effect, None)
        else:
            INSTRUMENT_EFFECTS[effect].numbers(chosen)
            self._concealed[effect] = chosen
        self._chains.clear()

    def apply(self, signal: str, sensor: str | None, time: float, value: Floats) -> Floats:
        """Pass a value through the filters of its signal.

        Args:
            signal: Kind of signal.
            sensor: Name of the sensor.
            time: When it is seen [s], not falling.
            value: Its true value.
        """
        if not self._concealed:
            return value
        key = signal, sensor
        if key not in self._chains:
            self._chains[key] = filters(tuple(self._concealed.values()), signal, sensor)
        for one in self._chains[key]:
            value = one.update(time, value)
        return value


def by_valve(signal_filter: SignalFilter, valve_map: Sequence[int]) -> SignalFilter:
    """Apply a signal of the chambers to the values of the valves that feed them.

    Args:
        signal_filter: Filters values in chamber order.
        valve_map: Valve of each chamber.
    """
    chosen = np.array(valve_map, dtype=np.int64)

    def see_valves(signal: str, sensor: str | None, time: float, value: Floats) -> Floats:
        measured = value.copy()
        measured[chosen] = signal_filter(signal, sensor, time, value[chosen])
        return measured

    return see_valves


def _read(effect: str, value: object) -> Concealed | None:
    if value is None or value == 0:
        return None
    table = dict(value) if isinstance(value, Mapping) else {"strength": value}
    where = table.pop("where", {})
    numbers = {name: n for name, n in table.items() if isinstance(n, int | float) and not isinstance(n, bool)}
    if len(numbers) < len(table) or not isinstance(where, Mapping):
        raise InputError(f"effect '{effect}'", f"value {value!r}", "give a number or a table of parameters")
    return Concealed(effect, dict(where), {name: float(n) for name, n in numbers.items()})

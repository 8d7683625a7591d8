"""Named faults of a fake: what there is, what is switched on, how often each one showed on the wire."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from softarm.estimator.errors import InputError

Value = bool | int | float | str


@dataclass(frozen=True)
class Fault:
    """One thing that can go wrong with a device.

    Args:
        name: What scenarios and the control port call it.
        text: What the host sees on the wire.
        once: It acts a number of times and is gone; otherwise it lasts until cleared.
        parameters: Its parameters with their default values, which also fix their types.
        limits: Lowest and highest value of a number; the choices of a word, of which several may be given
            with commas between.
    """

    name: str
    text: str
    once: bool = False
    parameters: Mapping[str, Value] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float] | tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ActiveFault:
    """A fault that is on; always true, also without parameters."""

    parameters: Mapping[str, Value]

    def __getitem__(self, name: str) -> Value:
        """Return one parameter."""
        return self.parameters[name]


class FaultBoard:
    """The switches of one fake."""

    def __init__(self, device: str, catalogue: Iterable[Fault]) -> None:
        self._device = device
        self.catalogue = {fault.name: fault for fault in catalogue}
        self.counts = dict.fromkeys(self.catalogue, 0)
        self._active: dict[str, ActiveFault] = {}
        self._left: dict[str, int] = {}
        self._listeners: list[Callable[[str, bool], None]] = []

    def listen(self, listener: Callable[[str, bool], None]) -> None:
        """Call ``listener(name, active)`` whenever a fault is switched."""
        self._listeners.append(listener)

    def set(self, name: str, parameters: Mapping[str, Value] | None = None, times: int = 1) -> None:
        """Switch a fault on.

        Args:
            name: One of the catalogue.
            parameters: Those that differ from their defaults.
            times: How often a fault that acts once is to act.

        Raises:
            InputError: Unknown fault or parameter, a value of another type, or ``times`` below one.
        """
        fault = self.check(name, parameters or {}, times)
        self._active[name] = ActiveFault({**fault.parameters, **(parameters or {})})
        if fault.once:
            self._left[name] = times
        self._notify(name, active=True)

    def check(self, name: str, parameters: Mapping[str, Value], times: int = 1) -> Fault:
        """Return the fault that a request means, or raise ``InputError``."""
        fault = self.catalogue.get(name)
        if fault is None:
            raise InputError(f"fakes, {self._device}", f"no fault {name!r}", nearest(name, self.catalogue))
        for key, value in parameters.items():
            _check_parameter(f"fakes, {self._device}.{name}", fault, key, value)
        if times < 1:
            raise InputError(f"fakes, {self._device}.{name}", f"times = {times}", "give 1 or more")
        return fault

    def clear(self, name: str | None = None) -> None:
        """Switch one fault off, or all of them."""
        if name is not None:
            self.check(name, {})
        for active in [name] if name is not None else list(self._active):
            if self._active.pop(active, None) is not None:
                self._left.pop(active, None)
                self._notify(active, active=False)

    def active(self, name: str) -> ActiveFault | None:
        """Return a fault that is on with its parameters, else None; counts nothing."""
        return self._active.get(name)

    def hit(self, name: str) -> ActiveFault | None:
        """Return a fault that is on with its parameters and count that it showed, else None.

        A fault that acts once is used up by as many hits as it was set for.
        """
        fault = self._active.get(name)
        if fault is None:
            return None
        self.counts[name] += 1
        if name in self._left:
            self._left[name] -= 1
            if self._left[name] == 0:
                self.clear(name)
        return fault

    def snapshot(self) -> dict[str, object]:
        """Return what is on, with its parameters, and the counts of what has acted."""
        return {
            "active": {name: dict(fault.parameters) for name, fault in self._active.items()},
            "counts": {name: count for name, count in self.counts.items() if count},
        }

    def _notify(self, name: str, *, active: bool) -> None:
        for listener in self._listeners:
            listener(name, active)


def nearest(name: str, candidates: Iterable[str]) -> str:
    """Return the known name that was probably meant."""
    names = list(candidates)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(names)}"


def _check_parameter(where: str, fault: Fault, key: str, value: Value) -> None:
    if key not in fault.parameters:
        parameters = fault.parameters
        raise InputError(
            where, f"no parameter {key!r}", nearest(key, parameters) if parameters else "it takes none"
        )
    default = fault.parameters[key]
    # JSON and TOML write 1 for 1.0; and in Python True is an int.
    wanted = (int, float) if isinstance(default, float) else type(default)
    if not isinstance(value, wanted) or (isinstance(value, bool) and not isinstance(default, bool)):
        raise InputError(where, f"{key} = {value!r}", f"give a value like {default!r}")
    if key in fault.limits:
        _check_limits(where, key, value, fault.limits[key])


def _check_limits(where: str, key: str, value: Value, limits: tuple[object, ...]) -> None:
    if isinstance(value, str):
        for word in value.split(","):
            if word not in limits:
                raise InputError(where, f"{key} names {word!r}", nearest(word, map(str, limits)))
        return
    low, high = limits
    if not float(str(low)) <= value <= float(str(high)):
        raise InputError(where, f"{key} = {value}", f"give {low} to {high}")

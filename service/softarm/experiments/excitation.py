"""Running an excitation on an arm: one recording per manoeuvre, over the network, within all limits."""

import json
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from softarm.estimator.errors import InputError
from softarm.estimator.excitation import ChosenManoeuvre, Manoeuvre
from softarm.estimator.specimen import Specimen
from softarm.experiments.session import recorded
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError

PERIOD_S = 0.05
LIFETIME_S = 1.0
VENT_S = 5.0
"""Time between two set-points, how long one lives, and how long the arm vents before a manoeuvre."""


@dataclass(frozen=True)
class Recorded:
    """A manoeuvre that was run.

    Args:
        manoeuvre: Its name.
        path: The recording, as the service named it.
        seconds: How long it took.
        gap_s: Longest time between two set-points.
    """

    manoeuvre: str
    path: str
    seconds: float
    gap_s: float


def specimen_of_arm(client: Arm) -> Specimen:
    """Request the specimen that the service runs on."""
    return Specimen.model_validate_json(client.ask("specimen"))


def slew_of(client: Arm) -> float | None:
    """Request the fastest change of a set-point that the service's valves allow [Pa/s]."""
    values = list(_values(json.loads(client.ask("config")), "slew_pa_per_s"))
    return min(values) if values else None


def _values(table: object, key: str) -> Sequence[float]:
    if isinstance(table, dict):
        values = [float(table[key])] if isinstance(table.get(key), int | float) else []
        return values + [v for part in table.values() for v in _values(part, key)]
    if isinstance(table, list):
        return [v for part in table for v in _values(part, key)]
    return []


def run_excitation(
    client: Arm,
    choices: Sequence[ChosenManoeuvre],
    ask: Callable[[Manoeuvre], bool],
    advance: Callable[[float], None],
) -> list[Recorded]:
    """Run manoeuvres one after another, each from the vented arm and each into a recording.

    The arm is armed only: the mode for experiments ends when the estimator fails, as it may well do on an arm
    whose model is wrong.

    Args:
        client: The arm's client, with the lease; it leaves the arm disarmed and vented.
        choices: What to run.
        ask: Requests what a manoeuvre needs of a person; where it returns false, the manoeuvre is left out.
        advance: Called with the seconds done.

    Raises:
        InputError: The arm has another number of chambers.
        CommandRefusedError: The service refuses a command, such as after a fault.
    """
    client.arm()
    try:
        return [
            run_manoeuvre(client, choice.manoeuvre, advance)
            for choice in choices
            if not choice.manoeuvre.by_hand or ask(choice.manoeuvre)
        ]
    finally:
        with suppress(CommandRefusedError):  # after a fault the arm is vented and cannot be disarmed
            client.disarm()


def run_manoeuvre(client: Arm, manoeuvre: Manoeuvre, advance: Callable[[float], None]) -> Recorded:
    """Vent, record, lead the set-points along the manoeuvre's path, and stop the recording."""
    chambers = len(client.state().measured_pa)
    if manoeuvre.pressures.shape[1] != chambers:
        what = f"has {chambers} chambers, the manoeuvre {manoeuvre.pressures.shape[1]}"
        raise InputError(client.keys.arm, what, "give the arm's own specimen")
    vented = Manoeuvre("vent", "", np.array([0.0, VENT_S]), np.zeros((2, chambers)))
    _follow(client, vented, lambda _: None)
    begin = time.monotonic()
    with recorded(client, f"excite_{manoeuvre.name}") as paths:
        lag = _follow(client, manoeuvre, advance)
    return Recorded(manoeuvre.name, paths[0], time.monotonic() - begin, lag)


def _follow(client: Arm, manoeuvre: Manoeuvre, advance: Callable[[float], None]) -> float:
    """Send the set-points of a manoeuvre as time goes by; return the longest time between two [s]."""
    pause = threading.Event()
    begin, before, longest = time.monotonic(), 0.0, 0.0
    while True:
        now = min(time.monotonic() - begin, manoeuvre.duration)
        wanted = manoeuvre.at(np.array([now]))[0]
        client.pressures.set(wanted.tolist(), lifetime_s=LIFETIME_S)
        longest = max(longest, now - before)
        advance(now - before)
        if now >= manoeuvre.duration:
            return longest
        before = now
        pause.wait(PERIOD_S)

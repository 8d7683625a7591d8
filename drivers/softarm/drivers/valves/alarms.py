"""Alarms of the valve bank: what is wrong and what to do."""

from softarm.drivers.alarms import Alarms
from softarm.drivers.valves.pressures import Pressures

WATCHDOG_FIRED = "watchdog fired"
FOREIGN_WRITER = "foreign writer"
UNKNOWN = "outputs unknown"
EXPIRED = "set-point expired"
BLOCKING = (WATCHDOG_FIRED, FOREIGN_WRITER, UNKNOWN)
"""While one of these stands the bank cannot be armed."""

DIAGNOSIS = " diagnosis"


def reports_fault(alarms: Alarms) -> bool:
    """Return whether the diagnosis of a valve is not clean."""
    return any(alarm.key.endswith(DIAGNOSIS) for alarm in alarms.active)


class ValveAlarms:
    """Keeps the alarms of one session up to date.

    Args:
        alarms: Where they stand.
        valve_of: Index of the valve of each chamber, for the words.
        reach_s: Time in which a set-point must be reached [s].
    """

    def __init__(self, alarms: Alarms, valve_of: tuple[int, ...], reach_s: float) -> None:
        self._alarms = alarms
        self._valve_of = valve_of
        self._reach_s = reach_s

    def watchdog_fired(self) -> bool:
        """Raise the alarm of zeros that nobody wrote in the terminal; return whether it is new."""
        return self._alarms.set(
            WATCHDOG_FIRED,
            "the terminal cleared its outputs, by its watchdog or a restart",
            "find out what kept the host or the network busy, then arm again",
        )

    def foreign_writer(self) -> bool:
        """Raise the alarm of set-points that another master wrote; return whether it is new."""
        return self._alarms.set(
            FOREIGN_WRITER,
            "another master writes to the valves",
            "disconnect the other master, then arm again",
        )

    def outputs(self, unknown: bool) -> None:
        """Raise or clear the alarm of a write without an answer, which may be carried out or not."""
        if unknown:
            self._alarms.set(
                UNKNOWN, "a write was not answered", "wait: the echo is read before the next write"
            )
        else:
            self._alarms.clear(UNKNOWN)

    def echo_is_ours(self) -> None:
        """Clear the alarms of the echo: the terminal holds what was written."""
        self._alarms.clear(WATCHDOG_FIRED)
        self._alarms.clear(FOREIGN_WRITER)

    def expired(self, now: bool, over: bool) -> None:
        """Raise the alarm of a set-point that ran out; the next one or disarming clears it."""
        if now:
            self._alarms.set(
                EXPIRED, "the set-point was not renewed, the chambers vent", "renew it within its lifetime"
            )
        elif over:
            self._alarms.clear(EXPIRED)

    def diagnosis(self, words: tuple[int, ...]) -> None:
        """Raise or clear the alarm of each valve whose diagnosis word is not zero."""
        for chamber, (valve, word) in enumerate(zip(self._valve_of, words, strict=True)):
            key = f"chamber {chamber}{DIAGNOSIS}"
            if word:
                what = f"valve {valve} of chamber {chamber} reports a fault"
                self._alarms.set(
                    key, what, "check supply pressure and the terminal's display", value=f"0x{word:04x}"
                )
            else:
                self._alarms.clear(key)

    def tracking(self, deviations: tuple[float | None, ...], applied: Pressures) -> None:
        """Raise or clear the alarm of each chamber whose pressure is not at its set-point."""
        for chamber, deviation in enumerate(deviations):
            key = f"chamber {chamber} tracking"
            if deviation is None:
                self._alarms.clear(key)
                continue
            side = "above" if deviation > 0 else "below"
            self._alarms.set(
                key,
                f"chamber {chamber} stays {side} the set-points for longer than {self._reach_s:g} s",
                "check supply, tubes and valve",
                value=round(applied[chamber] + deviation, 1),
                limit=applied[chamber],
                unit="Pa",
            )

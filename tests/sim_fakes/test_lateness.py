"""Fakes that starve say so once."""

from softarm.fakes.lateness import EVERY_S, LATE_S, watch_lateness


class LateClock:
    """A clock whose sleeps end late by given times [s]."""

    def __init__(self, late_s):
        self._time, self._late_s = 0.0, list(late_s)

    def now(self):
        return self._time

    async def sleep_until(self, time):
        self._time = time + self._late_s.pop(0)


async def test_fakes_that_come_late_say_so_once_with_the_time():
    said = []
    await watch_lateness(LateClock([0.0, 0.9 * LATE_S, 0.25, 0.5]), said.append)
    (line,) = said
    assert "250 ms late" in line
    assert EVERY_S < LATE_S

"""How long to wait before the next attempt."""

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random


@dataclass(frozen=True, slots=True)
class Backoff:
    """Capped exponential waiting with jitter, so that many devices do not retry in step.

    Attributes:
        first_s: Wait after the first failure [s].
        cap_s: Longest wait before jitter [s].
        factor: Growth from one failure to the next.
        jitter: Largest relative deviation, either way.
    """

    first_s: float = 0.1
    cap_s: float = 5.0
    factor: float = 2.0
    jitter: float = 0.2

    def delays(self, random: Random) -> Iterator[float]:
        """Return the waits of one run of failures [s], without end."""
        delay_s = self.first_s
        while True:
            yield delay_s * (1.0 + self.jitter * random.uniform(-1.0, 1.0))
            delay_s = min(delay_s * self.factor, self.cap_s)

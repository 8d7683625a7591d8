"""What the sequence numbers and the rate of an inertial unit show: lost samples, restarts, wrong settings."""

from dataclasses import dataclass
from typing import Final

from softarm.drivers.clock import NANOSECONDS

SILENCE_NS: Final = 150_000_000
"""Silence [ns] that a unit needs to start anew; a jump of the index without it is lost samples."""

PAUSE_NS: Final = 400_000_000
"""Silence [ns] that is no low rate but a pause."""

_SLACK: Final = 3


@dataclass(frozen=True, slots=True)
class SequenceStep:
    """One sample against the one before.

    Args:
        index: Sequence number without wrapping, from zero in each epoch.
        lost: Samples between the two that never came.
        restarted: Whether the unit has started anew between them.
    """

    index: int
    lost: int = 0
    restarted: bool = False


@dataclass(slots=True)
class IndexTracker:
    """Follows a wrapping sequence number.

    A gap is lost samples if the time that has passed fits it, and a restart if not: after a restart the index
    begins at zero, whatever the time.

    Args:
        modulus: Where the number starts again.
        period_ns: Time from one number to the next [ns]; None if not known, every gap is then lost samples.
    """

    modulus: int
    period_ns: int | None
    _last: tuple[int, int] | None = None
    _index: int = 0

    def restart(self) -> None:
        """Forget the last sample."""
        self._last = None

    def step(self, index: int, arrival_ns: int) -> SequenceStep:
        """Compare the number and arrival of a sample with those of the last one."""
        last, self._last = self._last, (index, arrival_ns)
        if last is None:
            self._index = 0
            return SequenceStep(0)
        passed = (index - last[0]) % self.modulus
        if passed != 1 and not self._fits(passed, arrival_ns - last[1]):
            self._index = 0
            return SequenceStep(0, restarted=True)
        self._index += passed
        return SequenceStep(self._index, lost=max(0, passed - 1))

    def _fits(self, passed: int, elapsed_ns: int) -> bool:
        """Return whether so many samples fit the time."""
        if self.period_ns is None or elapsed_ns <= SILENCE_NS:
            return True
        # The counter may have wrapped any number of times meanwhile, so only the remainder is compared.
        error = (elapsed_ns / self.period_ns - passed + self.modulus / 2) % self.modulus - self.modulus / 2
        return abs(error) <= _SLACK


@dataclass(slots=True)
class RateMonitor:
    """Measures the rate of samples over windows; a pause begins a new one.

    Args:
        window_ns: Length of a window [ns].
    """

    window_ns: int
    rate: float | None = None
    _start_ns: int | None = None
    _last_ns: int = 0
    _count: int = 0

    def restart(self) -> None:
        """Begin a new window with the next sample."""
        self.rate, self._start_ns, self._count = None, None, 0

    def sample(self, arrival_ns: int) -> bool:
        """Count a sample, and return whether a window has ended and `rate` [Hz] is new."""
        last_ns, self._last_ns = self._last_ns, arrival_ns
        if self._start_ns is None or arrival_ns - last_ns > PAUSE_NS:
            self._start_ns, self._count = arrival_ns, 0
            return False
        self._count += 1
        elapsed_ns = arrival_ns - self._start_ns
        if elapsed_ns < self.window_ns:
            return False
        self.rate = self._count * NANOSECONDS / elapsed_ns
        self._start_ns, self._count = arrival_ns, 0
        return True

"""Compares the echo of a terminal with the writes, to detect its watchdog and other masters."""

from collections import deque
from enum import Enum

Counts = tuple[int, ...]


class Verdict(Enum):
    """Whose set-points the echo shows."""

    OURS = "ours"
    ZEROED = "zeroed"
    FOREIGN = "foreign"


class EchoMonitor:
    """Compares the echo with the writes that may still be on their way into it.

    A terminal refreshes its echo once per cycle of its own, so the echo may be any of the writes of the last
    moments; it may never be anything else. Zeros where none were written mean that the terminal cleared its
    outputs, by watchdog or restart; anything else was written by another master.

    Args:
        lag_ns: How long a write may take to show once it was answered, or sent where no answer came [ns].
    """

    def __init__(self, lag_ns: int) -> None:
        self._lag_ns = lag_ns
        self._writes: deque[tuple[int, Counts]] = deque()
        self._answered = True
        self._before_last: bool | None = None

    def attempted(self, counts: Counts, now_ns: int) -> None:
        """Record a write that was sent, whether or not it was confirmed."""
        if self._writes and self._writes[-1][1] == counts:
            # Renewed every pass: its time is that of the change, or it would never be old.
            self._before_last = None
            return
        self._writes.append((now_ns, counts))
        self._before_last, self._answered = self._answered, False

    def refused(self) -> None:
        """Forget the last write: the terminal has not accepted it."""
        if self._before_last is not None:
            self._writes.pop()
            self._answered, self._before_last = self._before_last, None

    def answered(self, now_ns: int) -> None:
        """Record the answer to the last write, which may have waited before the terminal accepted it."""
        if not self._answered:
            self._writes[-1] = now_ns, self._writes[-1][1]
            self._answered = True

    def judge(self, echo: Counts, now_ns: int) -> Verdict:
        """Judge an echo that was just read."""
        # What was replaced longer ago than the lag may no longer show; the last write always may.
        while len(self._writes) > 1 and self._writes[1][0] <= now_ns - self._lag_ns:
            self._writes.popleft()
        if any(echo == counts for _, counts in self._writes):
            return Verdict.OURS
        return Verdict.ZEROED if not any(echo) else Verdict.FOREIGN

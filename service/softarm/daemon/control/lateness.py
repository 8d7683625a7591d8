"""How late the control loop comes, and whether a busy processor explains silent devices."""

from array import array
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SECOND_NS = 1_000_000_000
WINDOW_NS = 5_000_000_000
RECENT_NS = 500_000_000
LATE_NS = 20_000_000
"""Lateness of a tick from which the processor must have kept the loop waiting."""
STARVED_PERCENT = 20.0
"""Above this share of time some program that could run had to wait for a processor."""
PRESSURE = Path("/proc/pressure/cpu")
CGROUPS = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class TickDrift:
    """How late the ticks of the last seconds came.

    Args:
        median_s: Median [s].
        p99_s: 99th percentile [s].
    """

    median_s: float
    p99_s: float


class Lateness:
    """Keeps the drift of the ticks of the last seconds, and the worst of the last moments."""

    def __init__(self) -> None:
        self._times_ns, self._late_ns = array("q"), array("q")
        self._first = 0
        self._worst: deque[tuple[int, int]] = deque()  # falling: each is worse than those after it
        self.starved_percent: float | None = None

    def add(self, now_ns: int, late_ns: int) -> None:
        """Add a tick.

        Args:
            now_ns: Monotonic time at which it came.
            late_ns: How late the loop came, the ticks that it skipped included.
        """
        self._times_ns.append(now_ns)
        self._late_ns.append(late_ns)
        while now_ns - self._times_ns[self._first] > WINDOW_NS:
            self._first += 1
        # Cut only when half is old: deleting from the front at every tick would move the whole array.
        if 2 * self._first > len(self._times_ns):
            del self._times_ns[: self._first], self._late_ns[: self._first]
            self._first = 0
        while self._worst and self._worst[-1][1] <= late_ns:
            self._worst.pop()
        self._worst.append((now_ns, late_ns))

    @property
    def drift(self) -> TickDrift | None:
        """Median and 99th percentile over the last seconds; ``None`` before the first tick."""
        if not self._late_ns:
            return None
        drifts = np.array(self._late_ns[self._first :]) * 1e-9
        median, p99 = np.percentile(drifts, [50.0, 99.0])
        return TickDrift(float(median), float(p99))

    def busy(self, now_ns: int) -> str:
        """Describe how the processor keeps the service waiting; empty when it does not."""
        while self._worst and now_ns - self._worst[0][0] > RECENT_NS:
            self._worst.popleft()
        worst_ns = self._worst[0][1] if self._worst else 0
        if worst_ns > LATE_NS:
            return f"the control loop came {worst_ns * 1e-6:.0f} ms late"
        if self.starved_percent is not None and self.starved_percent > STARVED_PERCENT:
            return f"programs waited for the processor {self.starved_percent:.0f} % of the time"
        return ""


class SkippedTicks:
    """Counts the ticks that were skipped: all of them, and those of the last second."""

    def __init__(self) -> None:
        self.total = 0
        self._recent: deque[tuple[int, int]] = deque()
        self._recent_total = 0

    def add(self, now_ns: int, missed: int) -> None:
        """Add ticks that were skipped just before a monotonic time."""
        if missed:
            self.total += missed
            self._recent.append((now_ns, missed))
            self._recent_total += missed

    def recent(self, now_ns: int) -> int:
        """Return how many were skipped in the second before a monotonic time."""
        while self._recent and now_ns - self._recent[0][0] >= SECOND_NS:
            self._recent_total -= self._recent.popleft()[1]
        return self._recent_total


def pressure_files(cgroup_file: Path = Path("/proc/self/cgroup")) -> tuple[Path, ...]:
    """List the pressure files of Linux: of the host, which a unit may not see, and of this unit."""
    try:
        groups = [line for line in cgroup_file.read_text().splitlines() if line.startswith("0::/")]
    except OSError:
        groups = []
    return PRESSURE, *(CGROUPS / line.removeprefix("0::/") / "cpu.pressure" for line in groups)


def read_pressure(paths: Iterable[Path] | None = None) -> float | None:
    """Read the share of the last ten seconds in which a program waited for a processor [%].

    Linux counts it (pressure stall information, line ``some``, field ``avg10``).

    Args:
        paths: Files to read, the first that can be read counts; those of this process when left out.

    Returns:
        The share, or ``None`` where the kernel does not count it.
    """
    # Line `some avg10=1.23 avg60=...`; a container may hide the file, a kernel without PSI lacks it.
    for path in pressure_files() if paths is None else paths:
        try:
            words = path.read_text().split()
            return float(words[1].removeprefix("avg10="))
        except (OSError, ValueError, IndexError):
            continue
    return None

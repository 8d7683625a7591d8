"""Check of tracking: the measured pressure must stay between the recent set-points."""

from collections import deque

from softarm.drivers.valves.pressures import Pressures


class TrackingMonitor:
    """Compares each chamber's measured pressure with the set-points of the last moments.

    A chamber on its way from one set-point to the next lies between them. So the measurement must stay
    between the lowest and the highest set-point of the last ``reach_ns``, to a tolerance; the test needs
    no model of the pneumatics and works on set-points that never rest.

    Args:
        chambers: How many chambers.
        reach_ns: Time in which a set-point must be reached [ns].
        tolerance: Allowed deviation [Pa].
        confirm_ns: A deviation counts once it has lasted so long [ns].
    """

    def __init__(self, chambers: int, reach_ns: int, tolerance: float, confirm_ns: int) -> None:
        self._reach_ns = reach_ns
        self._tolerance = tolerance
        self._confirm_ns = confirm_ns
        self._lowest = [Extreme(-1) for _ in range(chambers)]
        self._highest = [Extreme(1) for _ in range(chambers)]
        self._started = [False] * chambers
        self._outside_since: list[int | None] = [None] * chambers

    def update(self, applied: Pressures, readback: Pressures, now_ns: int) -> tuple[float | None, ...]:
        """Compare the measurements of one pass with the recent set-points.

        Args:
            applied: Gauge pressure written to each chamber [Pa].
            readback: Gauge pressure measured in each chamber [Pa].
            now_ns: Host monotonic time [ns].

        Returns:
            For each chamber None while all is well, else by how much the measurement
            lies above (positive) or below the recent set-points [Pa].
        """
        return tuple(
            self._judge(chamber, setpoint, measured, now_ns)
            for chamber, (setpoint, measured) in enumerate(zip(applied, readback, strict=True))
        )

    def _judge(self, chamber: int, setpoint: float, measured: float, now_ns: int) -> float | None:
        oldest_ns = now_ns - self._reach_ns
        if not self._started[chamber]:
            # Earlier set-points are unknown; the chamber may be on its way from where it is.
            self._started[chamber] = True
            self._lowest[chamber].push(now_ns, measured, oldest_ns)
            self._highest[chamber].push(now_ns, measured, oldest_ns)
        low = self._lowest[chamber].push(now_ns, setpoint, oldest_ns)
        high = self._highest[chamber].push(now_ns, setpoint, oldest_ns)
        deviation = max(0.0, measured - high) + min(0.0, measured - low)
        if abs(deviation) <= self._tolerance:
            self._outside_since[chamber] = None
            return None
        since_ns = self._outside_since[chamber]
        if since_ns is None:
            self._outside_since[chamber] = since_ns = now_ns
        return deviation if now_ns - since_ns >= self._confirm_ns else None


class Extreme:
    """Sliding extreme of a signal that holds its value between samples, at constant cost per sample.

    Args:
        sign: 1 for the highest, -1 for the lowest.
    """

    def __init__(self, sign: int) -> None:
        self._sign = sign
        self._entries: deque[tuple[int, float]] = deque()
        self._before: float | None = None

    def push(self, now_ns: int, value: float, oldest_ns: int) -> float:
        """Add a sample and return the extreme since ``oldest_ns``."""
        if self._before is None:
            self._before = value
        # The value held until now counts up to now, so that a jump is inside the window for its whole length.
        for entry in (value,) if value == self._before else (self._before, value):
            while self._entries and self._sign * (self._entries[-1][1] - entry) <= 0:
                self._entries.pop()
            self._entries.append((now_ns, entry))
        self._before = value
        while self._entries[0][0] < oldest_ns:
            self._entries.popleft()
        return self._entries[0][1]

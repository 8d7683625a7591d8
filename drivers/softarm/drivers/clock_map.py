"""Device time on the host's clock, from arrivals that are late by an unknown, varying delay."""

from bisect import bisect_right

from softarm.drivers.clock import NANOSECONDS

BUCKET_NS = NANOSECONDS // 2  # long enough that one arrival in it was hardly delayed
BUCKETS = 64
SKEW_SPAN_NS = 5 * NANOSECONDS
SKEW_LIMIT = 1e-3

Point = tuple[int, int]


class ClockMap:
    """Maps device time to host monotonic time with a minimum-delay filter.

    Each arrival gives ``host - device = offset + skew * device + delay`` with ``delay >= 0``. The fastest
    arrival of each half second is kept, for 32 s; offset and skew are those of the line that lies under all
    kept points and closest to them in the sum: the edge of their lower convex hull under the mean device time
    (S. B. Moon, P. Skelly, D. Towsley, "Estimation and removal of clock skew from network delay
    measurements", INFOCOM 1999). Until five seconds are covered the skew counts as zero.

    It cannot see the smallest delay itself: mapped times are late by that constant.
    """

    def __init__(self) -> None:
        self.epoch: int | None = None
        self.offset_ns = 0.0
        self.skew = 0.0
        self._origin: Point = (0, 0)
        self._bucket = -1
        self._points: list[Point] = []

    def update(self, device_ns: int, host_ns: int, epoch: int = 0) -> int:
        """Update the map with one arrival and return when its sample was measured.

        Args:
            device_ns: Device time of the sample [ns].
            host_ns: Host monotonic time of its arrival [ns].
            epoch: Epoch of the device clock; another one than before starts the filter again.

        Returns:
            Host monotonic time of the sample [ns], never later than the arrival.
        """
        if epoch != self.epoch:
            self._restart(device_ns, host_ns, epoch)
        time_ns = device_ns - self._origin[0]
        delay_ns = host_ns - self._origin[1] - time_ns
        self._keep(time_ns, delay_ns)
        excess_ns = self.offset_ns + self.skew * time_ns - delay_ns
        # No sample arrives before it was measured: the line is lowered until it lies under this arrival.
        if excess_ns > 0:
            self.offset_ns -= excess_ns
        return min(host_ns, self.to_host(device_ns))

    def to_host(self, device_ns: int) -> int:
        """Map device time to host monotonic time [ns] by the present offset and skew."""
        time_ns = device_ns - self._origin[0]
        return self._origin[1] + time_ns + round(self.offset_ns + self.skew * time_ns)

    def _restart(self, device_ns: int, host_ns: int, epoch: int) -> None:
        self.epoch = epoch
        self.offset_ns = self.skew = 0.0
        self._origin = (device_ns, host_ns)
        self._bucket = -1
        self._points = []

    def _keep(self, time_ns: int, delay_ns: int) -> None:
        bucket = time_ns // BUCKET_NS
        if bucket == self._bucket and self._points:
            if delay_ns < self._points[-1][1]:
                self._points[-1] = (time_ns, delay_ns)
            return
        if bucket < self._bucket:
            return  # stopped_since on the way: the hull needs rising times
        self._fit()
        self._bucket = bucket
        self._points.append((time_ns, delay_ns))
        del self._points[:-BUCKETS]

    def _fit(self) -> None:
        points = self._points
        if len(points) < 2:
            return
        self.skew = 0.0
        if points[-1][0] - points[0][0] >= SKEW_SPAN_NS:
            mean_ns = sum(time for time, _ in points) / len(points)
            start, end = _edge_under(_lower_hull(points), mean_ns)
            slope = (end[1] - start[1]) / (end[0] - start[0])
            # Oscillators differ by less than this; a steeper line comes from delays.
            self.skew = slope if abs(slope) <= SKEW_LIMIT else 0.0
        self.offset_ns = min(delay - self.skew * time for time, delay in points)


def _lower_hull(points: list[Point]) -> list[Point]:
    """Find the lower convex hull of points that are sorted by time (Andrew's monotone chain)."""
    hull: list[Point] = []
    for point in points:
        while len(hull) >= 2 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return hull


def _turns_right(first: Point, second: Point, third: Point) -> bool:
    cross = (second[0] - first[0]) * (third[1] - first[1]) - (second[1] - first[1]) * (third[0] - first[0])
    return cross <= 0


def _edge_under(hull: list[Point], time_ns: float) -> tuple[Point, Point]:
    end = min(max(bisect_right([time for time, _ in hull], time_ns), 1), len(hull) - 1)
    return hull[end - 1], hull[end]

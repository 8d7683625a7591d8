"""Times counted in logarithmic bins, each at most an eighth wide: no growth and no sorting."""

from collections.abc import Mapping

SUB_BITS = 3
SUB_BINS = 1 << SUB_BITS
BINS = SUB_BINS * 48


class Histogram:
    """Counts of durations, eight bins to the octave, from a nanosecond to days."""

    __slots__ = ("_counts", "count", "largest_ns", "total_ns")

    def __init__(self) -> None:
        self._counts = [0] * BINS
        self.count = 0
        self.total_ns = 0
        self.largest_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration [ns]; a negative one counts as zero."""
        duration_ns = max(duration_ns, 0)
        self._counts[_bin(duration_ns)] += 1
        self.count += 1
        self.total_ns += duration_ns
        self.largest_ns = max(self.largest_ns, duration_ns)

    def quantile_ns(self, fraction: float) -> int:
        """Return the duration [ns] that this fraction does not exceed, to one bin; 0 when empty."""
        wanted = fraction * self.count
        passed = 0
        for index, count in enumerate(self._counts):
            passed += count
            if count and passed >= wanted:
                return min(_upper_edge(index), self.largest_ns)
        return 0

    @property
    def mean_ns(self) -> float:
        """Mean duration [ns]; 0 when empty."""
        return self.total_ns / self.count if self.count else 0.0

    def summary(self) -> Mapping[str, float]:
        """Sum up in microseconds, for people."""
        return {
            "count": self.count,
            "mean_us": self.mean_ns / 1e3,
            "p50_us": self.quantile_ns(0.50) / 1e3,
            "p99_us": self.quantile_ns(0.99) / 1e3,
            "max_us": self.largest_ns / 1e3,
        }


def _bin(duration_ns: int) -> int:
    shift = duration_ns.bit_length() - SUB_BITS - 1
    if shift <= 0:
        return duration_ns
    return min(((shift + 1) << SUB_BITS) + (duration_ns >> shift) - SUB_BINS, BINS - 1)


def _upper_edge(index: int) -> int:
    if index < 2 * SUB_BINS:
        return index
    shift = (index >> SUB_BITS) - 1
    return ((SUB_BINS + (index & (SUB_BINS - 1)) + 1) << shift) - 1

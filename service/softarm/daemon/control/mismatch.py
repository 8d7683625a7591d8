"""Running test of the model against the measurements."""

from dataclasses import dataclass, field, replace

SLACK = 1.0
"""Allowed excess of the normalised innovation squared per degree of freedom, before it counts."""
ALARM = 2.0
"""Sum of the excess [s] at which the two are called inconsistent (Page's CUSUM)."""
CAP = 6.0
"""Largest sum [s]: recovery takes no longer than this over the slack."""
LARGEST = 6.0
"""An innovation counts at most as this multiple of its expectation: one outlier is no mismatch."""


@dataclass(frozen=True)
class MismatchTest:
    """A one-sided cumulative sum of the normalised innovations; each update returns the next one.

    With s the sum, r the innovation squared over its expectation and dt the time since the last update:
    s' = min(max(s + (min(r, LARGEST) - 1 - SLACK) dt, 0), CAP) (Page 1954). Inconsistent once s passes
    ``ALARM``, consistent again when s is back at 0.

    Args:
        total: The sum [s].
        ratio: Running mean of r, over about a second.
        where: Running mean of each sensor's normalised residual.
        since_unix_ns: Since when the two differ; ``None`` while they do not.
        time_s: Time of the last update [s].
    """

    total: float = 0.0
    ratio: float | None = None
    where: dict[str, float] = field(default_factory=dict)
    since_unix_ns: int | None = None
    time_s: float | None = None

    @property
    def consistent(self) -> bool:
        """Whether model and measurements agree."""
        return self.since_unix_ns is None

    @property
    def suspects(self) -> tuple[str, ...]:
        """Sensors whose innovations stand out, the worst first."""
        worst = sorted(self.where, key=lambda name: -self.where[name])
        return tuple(name for name in worst if self.where[name] > 1.0 + SLACK)

    def update(
        self,
        time_s: float,
        innovation_squared: float,
        degrees_of_freedom: float,
        innovations: dict[str, float],
        unix_ns: int,
    ) -> "MismatchTest":
        """Update the test with the innovations of one estimate.

        Args:
            time_s: Time of the readings [s].
            innovation_squared: Normalised innovation squared.
            degrees_of_freedom: Its expectation when the model is right; nothing is decided below a tenth.
            innovations: Normalised residual of each sensor.
            unix_ns: Wall clock.
        """
        # At most a second: a gap in the estimates is no evidence against the model.
        step = 0.0 if self.time_s is None else min(max(time_s - self.time_s, 0.0), 1.0)
        if degrees_of_freedom < 0.1:
            return replace(self, time_s=time_s)
        ratio = innovation_squared / degrees_of_freedom
        excess = min(ratio, LARGEST) - 1.0 - SLACK
        total = min(max(self.total + excess * step, 0.0), CAP)
        since = self.since_unix_ns
        if since is None and total > ALARM:
            since = unix_ns
        elif total == 0.0:
            since = None
        blend = step / (1.0 + step)
        mean = ratio if self.ratio is None else self.ratio + blend * (ratio - self.ratio)
        where = {
            name: self.where.get(name, value) + blend * (value - self.where.get(name, value))
            for name, value in innovations.items()
        }
        return MismatchTest(total, mean, where, since, time_s)

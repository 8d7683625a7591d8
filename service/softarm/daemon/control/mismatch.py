"""Running test of the model against the measurements."""

from dataclasses import dataclass, field, replace


@dataclass(frozen=True)
class MismatchSettings:
    """How soon and how surely the test decides.

    Args:
        slack: Allowed excess of the normalised innovation squared per degree of freedom, before it counts.
        alarm: Sum of the excess [s] at which the two are called inconsistent (Page's CUSUM).
        cap: Largest sum [s]: recovery takes no longer than this over the slack.
        largest: An innovation counts at most as this multiple of its expectation: one outlier is no mismatch.
    """

    slack: float = 1.0
    alarm: float = 2.0
    cap: float = 6.0
    largest: float = 6.0


@dataclass(frozen=True)
class MismatchTest:
    """A one-sided cumulative sum of the normalised innovations; each update returns the next one.

    With s the sum, r the innovation squared over its expectation and dt the time since the last update:
    s' = min(max(s + (min(r, largest) - 1 - slack) dt, 0), cap) (Page 1954). Inconsistent once s passes
    ``alarm``, consistent again when s is back at 0.

    Args:
        settings: Slack and alarm.
        total: The sum [s].
        ratio: Running mean of r, over about a second.
        where: Running mean of each sensor's normalised residual.
        since_unix_ns: Since when the two differ; ``None`` while they do not.
        time_s: Time of the last update [s].
    """

    settings: MismatchSettings = MismatchSettings()
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
        return tuple(name for name in worst if self.where[name] > 1.0 + self.settings.slack)

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
        step = 0.0 if self.time_s is None else min(max(time_s - self.time_s, 0.0), 1.0)
        if degrees_of_freedom < 0.1:
            return replace(self, time_s=time_s)
        ratio = innovation_squared / degrees_of_freedom
        excess = min(ratio, self.settings.largest) - 1.0 - self.settings.slack
        total = min(max(self.total + excess * step, 0.0), self.settings.cap)
        since = self.since_unix_ns
        if since is None and total > self.settings.alarm:
            since = unix_ns
        elif total == 0.0:
            since = None
        blend = step / (1.0 + step)
        mean = ratio if self.ratio is None else self.ratio + blend * (ratio - self.ratio)
        where = {
            name: self.where.get(name, value) + blend * (value - self.where.get(name, value))
            for name, value in innovations.items()
        }
        return MismatchTest(self.settings, total, mean, where, since, time_s)

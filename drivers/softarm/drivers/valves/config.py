"""Settings of a valve bank."""

from abc import abstractmethod
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from softarm.drivers.config import DriverConfig, Seconds
from softarm.drivers.valves.registers import RegisterLayout

COUNT_LIMIT = 0x7FFF
"""Words are signed."""
WATCHDOG_MIN_MS = 100
"""Festo's own client sets no shorter one, which might exclude the node from the terminal."""
PASSES_PER_WATCHDOG = 3
"""Two passes in a row may fail before the terminal vents."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


def _listed(value: Any) -> Any:
    """Return one number as a list of one, so that an error in it is reported once."""
    return (value,) if isinstance(value, (int, float)) else value


class ValveConfig(DriverConfig):
    """The settings of every valve terminal.

    Attributes:
        host: Address of the terminal.
        port: TCP port.
        unit: Modbus unit.
        chambers: Valve index of each chamber, from 0.
        maximum_pa: Highest gauge pressure [Pa], for all chambers or one each.
        slew_pa_per_s: Fastest change of a set-point [Pa/s].
        max_lifetime_s: Longest lifetime of a set-point [s].
        rate_hz: Passes per second.
        watchdog_ms: Time-out to set in the terminal [ms].
        response_timeout_s: Time for one answer [s].
        lost_after_misses: Passes in a row without an answer after which the connection counts as lost.
        verify_every: Every so many passes the echo is read before the write. At 1 nothing that others
            wrote goes unseen; above, a pass mostly needs one request, and what was overwritten within a
            few passes may go unseen.
        echo_lag_s: How long a write may take to show in the echo [s].
        reach_s: Time in which a set-point must be reached [s].
        tracking_tolerance_pa: Allowed deviation of a measured pressure [Pa].
        tracking_confirm_s: A deviation counts once it has lasted so long [s].
        pascal_per_count: Pressure of one count of the terminal [Pa]; 100 where it counts in mbar.
    """

    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 502
    unit: Annotated[int, Field(ge=0, le=255)] = 1
    chambers: Annotated[tuple[int, ...], Field(min_length=1)]
    maximum_pa: Annotated[tuple[Positive, ...], BeforeValidator(_listed)]
    slew_pa_per_s: Positive = 200_000.0
    max_lifetime_s: Seconds = 1.0
    rate_hz: Annotated[float, Field(gt=0, le=500)] = 100.0
    watchdog_ms: Annotated[int, Field(ge=WATCHDOG_MIN_MS, le=65535)] = 180
    response_timeout_s: Annotated[float, Field(gt=0, le=0.1)] = 0.1
    lost_after_misses: Annotated[int, Field(ge=1)] = 3
    verify_every: Annotated[int, Field(ge=1)] = 1
    echo_lag_s: Seconds = 0.1
    reach_s: Seconds = 1.5
    tracking_tolerance_pa: Positive = 3_000.0
    tracking_confirm_s: Seconds = 0.2
    pascal_per_count: Positive = 100.0
    stale_after_s: Seconds = 0.15

    @abstractmethod
    def layout(self) -> RegisterLayout:
        """Return where the terminal keeps its valves."""

    @property
    def maximum(self) -> tuple[float, ...]:
        """Highest gauge pressure of each chamber [Pa]."""
        return self.maximum_pa * len(self.chambers) if len(self.maximum_pa) == 1 else self.maximum_pa

    @model_validator(mode="after")
    def _chambers_fit(self) -> "ValveConfig":
        valves = self.layout().valves
        taken: dict[int, int] = {}
        for chamber, valve in enumerate(self.chambers):
            if not 0 <= valve < valves:
                raise ValueError(
                    f"chamber {chamber} names valve {valve}, but they run from 0 to {valves - 1}"
                )
            if valve in taken:
                raise ValueError(f"chambers {taken[valve]} and {chamber} are both mapped to valve {valve}")
            taken[valve] = chamber
        return self

    @model_validator(mode="after")
    def _pressures_fit(self) -> "ValveConfig":
        if len(self.maximum) != len(self.chambers):
            raise ValueError(f"maximum_pa has {len(self.maximum)} entries for {len(self.chambers)} chambers")
        most = COUNT_LIMIT * self.pascal_per_count
        if max(self.maximum) > most:
            raise ValueError(f"maximum_pa {max(self.maximum):g} exceeds the {most:g} Pa that a word can hold")
        return self

    @model_validator(mode="after")
    def _watchdog_fits(self) -> "ValveConfig":
        least_ms = PASSES_PER_WATCHDOG * 1000.0 / self.rate_hz
        if self.watchdog_ms < least_ms:
            raise ValueError(
                f"watchdog_ms {self.watchdog_ms} is less than {PASSES_PER_WATCHDOG} passes ({least_ms:g} ms)"
            )
        return self

    def address(self) -> str:
        """Return the address as a URL."""
        return f"modbus+tcp://{self.host}:{self.port}"

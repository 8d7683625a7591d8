"""The one place that checks a set-point against the limits, before any write."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from softarm.drivers.errors import LimitError


@dataclass(frozen=True, slots=True)
class PressureLimits:
    """Limits of the chambers.

    Attributes:
        maximum: Highest gauge pressure of each chamber [Pa]; the lowest is zero.
        slew: Fastest change [Pa/s].
        lifetime_s: Longest lifetime of a set-point [s].
    """

    maximum: tuple[float, ...]
    slew: float
    lifetime_s: float


def check_setpoint(device: str, setpoint: Sequence[float], maximum: Sequence[float]) -> None:
    """Refuse a set-point of the wrong size, or one that is not finite, negative or too high.

    Args:
        device: The device, for errors.
        setpoint: Gauge pressure of each chamber [Pa].
        maximum: Highest gauge pressure of each chamber [Pa].

    Raises:
        LimitError: With the chamber, its value and its limit.
    """
    if len(setpoint) != len(maximum):
        what = "set-point has the wrong number of chambers"
        count = len(maximum)
        raise LimitError(device, what, f"give {count} pressures", value=len(setpoint), limit=count)
    for chamber, (pressure, most) in enumerate(zip(setpoint, maximum, strict=True)):
        # Never negative: such a valve goes wild at a negative set-point. NaN would become some integer.
        if not (math.isfinite(pressure) and 0.0 <= pressure <= most):
            what = f"set-point of chamber {chamber} is out of range ({pressure:g} Pa)"
            cure = f"ask for 0 to {most:g} Pa gauge"
            raise LimitError(device, what, cure, value=pressure, limit=float(most), unit="Pa")


def limit_step(
    device: str, setpoint: Sequence[float], previous: Sequence[float], limits: PressureLimits, seconds: float
) -> tuple[float, ...]:
    """Move from the previous pressures towards a set-point as far as the limits allow.

    Out-of-range values are refused, never clamped. A step that is too fast is shortened, and what comes
    back then differs from the set-point: that is what to report as applied.

    Args:
        device: The device, for errors.
        setpoint: Gauge pressure of each chamber [Pa].
        previous: Gauge pressure applied so far [Pa].
        limits: Limits of the chambers.
        seconds: Time for this step [s].

    Returns:
        Gauge pressure to apply in each chamber [Pa].

    Raises:
        LimitError: A value is not finite, negative or above the maximum of its chamber, or their
            number is wrong.
    """
    check_setpoint(device, setpoint, limits.maximum)
    step = limits.slew * seconds
    return tuple(
        before + min(max(target - before, -step), step)
        for target, before in zip(setpoint, previous, strict=True)
    )


def limit_lifetime(device: str, lifetime_s: float, limits: PressureLimits) -> None:
    """Refuse a lifetime that is not positive, or longer than allowed.

    Raises:
        LimitError: With the value and the limit.
    """
    if not 0.0 < lifetime_s <= limits.lifetime_s:
        what = "lifetime of the set-point is out of range"
        cure = f"give up to {limits.lifetime_s:g} s and renew it in time"
        raise LimitError(device, what, cure, value=lifetime_s, limit=limits.lifetime_s, unit="s")

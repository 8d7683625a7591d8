"""From the readings of any device to named channels of plain numbers."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

from softarm.drivers.bend.device import BendAngles
from softarm.drivers.gauges.force import Force
from softarm.drivers.imu.sample import ImuSample
from softarm.drivers.qualisys.motion import MotionFrame
from softarm.drivers.reading import Reading
from softarm.drivers.valves import BankReading


@dataclass(frozen=True, slots=True)
class Sample:
    """The last reading of one channel.

    Args:
        values: SI units; a pose is position and quaternion, an orientation a quaternion, a bend two angles,
            a gauge one force, a valve bank the measured pressures.
        measured_ns: Best estimate of the monotonic time of the measurement.
        arrival_ns: Monotonic time of arrival.
        device_ns: Time on the device's clock; that of the measurement where it has none.
        sequence: The device's counter.
        source: Where it came from.
    """

    values: tuple[float, ...]
    measured_ns: int
    arrival_ns: int
    device_ns: int
    sequence: int
    source: str


@singledispatch
def parts(value: Any) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Take a device's value apart into channels; what is invalid in it is left out.

    Raises:
        TypeError: No driver makes values of this type.
    """
    raise TypeError(f"no channels are known for {type(value).__name__}")


@parts.register
def _(value: BankReading) -> Iterator[tuple[str, tuple[float, ...]]]:
    yield "", value.readback


@parts.register
def _(value: MotionFrame) -> Iterator[tuple[str, tuple[float, ...]]]:
    for name, pose in value.poses.items():
        if pose is not None:
            yield name, (*pose.position, *pose.quaternion)


@parts.register
def _(value: BendAngles) -> Iterator[tuple[str, tuple[float, ...]]]:
    for index, (angles, valid) in enumerate(zip(value.angles, value.valid, strict=True)):
        if valid:
            yield str(index), angles


@parts.register
def _(value: ImuSample) -> Iterator[tuple[str, tuple[float, ...]]]:
    yield "", value.quaternion


@parts.register
def _(value: Force) -> Iterator[tuple[str, tuple[float, ...]]]:
    yield "", (value.force,)


def samples(reading: Reading[Any]) -> Iterator[tuple[str, Sample]]:
    """Give the channels of one valid reading, named ``device`` or ``device/channel``."""
    if not reading.valid:
        return
    device_ns = reading.measured_ns if reading.device_time_ns is None else reading.device_time_ns
    for channel, values in parts(reading.value):
        name = f"{reading.device}/{channel}" if channel else reading.device
        yield (
            name,
            Sample(
                values,
                reading.measured_ns,
                reading.host_monotonic_ns,
                device_ns,
                reading.sequence,
                reading.source,
            ),
        )

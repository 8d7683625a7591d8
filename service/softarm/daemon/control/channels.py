"""From the readings of any device to named channels of plain numbers."""

from collections.abc import Iterator
from functools import singledispatch
from typing import Any

from softarm.drivers.bend.device import BendAngles
from softarm.drivers.gauges.force import GaugeForce
from softarm.drivers.imu.sample import ImuSample
from softarm.drivers.qualisys.poses import MotionFrame
from softarm.drivers.reading import Reading
from softarm.drivers.valves import BankReading

ChannelReading = Reading[tuple[float, ...]]
"""A reading of one channel, whose `device` is ``device`` or ``device/channel``.

Its value is in SI units: a pose is position and quaternion, an orientation a quaternion, a bend two angles, a
gauge one force, a valve bank the measured pressures.
"""


@singledispatch
def parts(value: Any) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Split a device's value into channels, without its invalid parts.

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
def _(value: GaugeForce) -> Iterator[tuple[str, tuple[float, ...]]]:
    yield "", (value.force,)


def channel_readings(reading: Reading[Any]) -> Iterator[ChannelReading]:
    """Split a valid reading of a device into one for each channel that is valid in it."""
    if not reading.valid:
        return
    for channel, values in parts(reading.value):
        name = f"{reading.device}/{channel}" if channel else reading.device
        yield reading._replace(device=name, value=values)

"""Whether the tables of a configuration fit each other, the devices and the specimen."""

from collections.abc import Iterator, Sequence

from softarm.daemon.settings import SensorSettings, ServiceConfig
from softarm.drivers.config import DriverConfig
from softarm.drivers.valves.config import ValveConfig
from softarm.estimator.specimen import Specimen
from softarm_client.errors import SetupError
from softarm_client.session import unauthenticated_endpoints

TICKS_PER_LIFETIME = 3
"""What the loop renews must live for so many ticks: one may come late and one be skipped."""
PERIODS_PER_READING = 2
"""A sensor may miss one reading before it is stale."""
PLACED = ("pose", "orientation")
"""Kinds of sensors that are recorded as the frame of their section."""


def inconsistencies(
    config: ServiceConfig, specimen: Specimen, devices: Sequence[DriverConfig]
) -> Iterator[str]:
    """Find values that are each valid and do not fit together.

    Args:
        config: The configuration.
        specimen: The specimen that it names.
        devices: Its devices; empty when they are not valid.

    Yields:
        One line a misfit: the field, what is wrong, what to write.
    """
    yield from _unguarded_listeners(config)
    yield from _doubled_sensors(config.sensors)
    yield from _short_lifetimes(config)
    for index, device in enumerate(devices):
        if isinstance(device, ValveConfig):
            yield from _valves(f"devices[{index}] ({device.name})", device, config, specimen)
    yield from _slow_sensors(config, devices)


def _unguarded_listeners(config: ServiceConfig) -> Iterator[str]:
    try:
        unguarded = unauthenticated_endpoints(config.network)
    except SetupError as error:
        yield f"network.zenoh_config: {error}"
        return
    for endpoint in unguarded:
        yield (
            f"network.listen: {endpoint} lets everybody on the network move the arm; name a file with users "
            "or client certificates in network.zenoh_config (deploy/zenoh), listen on 127.0.0.1, or set "
            "network.allow_unauthenticated = true"
        )


def _doubled_sensors(sensors: Sequence[SensorSettings]) -> Iterator[str]:
    taken: dict[tuple[str, str], int] = {}
    for index, sensor in enumerate(sensors):
        place = ("frame" if sensor.kind in PLACED else sensor.kind, sensor.section)
        if place in taken:
            yield (
                f"sensors.{index}: {sensor.kind} of {sensor.section!r} is measured by sensors.{taken[place]} "
                "already; keep one pose or orientation, one bend and one gauge for each section"
            )
        taken.setdefault(place, index)


def _short_lifetimes(config: ServiceConfig) -> Iterator[str]:
    """Find deadlines that pass between two ticks of the control loop."""
    least_s = TICKS_PER_LIFETIME / config.control.rate_hz
    for name in ("setpoint_lifetime_s", "lease_s", "estimator_deadline_s"):
        seconds = getattr(config.safety, name)
        if seconds < least_s:
            yield (
                f"safety.{name}: {seconds:g} s is less than {TICKS_PER_LIFETIME} ticks at control.rate_hz = "
                f"{config.control.rate_hz:g}; write at least {least_s:g}, or raise the rate"
            )


def _valves(place: str, valves: ValveConfig, config: ServiceConfig, specimen: Specimen) -> Iterator[str]:
    limits = specimen.pressure_limits
    if len(valves.chambers) != len(limits):
        yield (
            f"{place}.chambers: {len(valves.chambers)} valves, but the specimen has {len(limits)} chambers; "
            "name one valve for each chamber"
        )
    for chamber, (most, limit) in enumerate(zip(valves.maximum, limits, strict=False)):
        if most > limit:
            yield (
                f"{place}.maximum_pa: {most:g} Pa for chamber {chamber}, but the specimen withstands "
                f"{limit:g} Pa; write at most that"
            )
    lifetime_s, deadline_s = config.safety.setpoint_lifetime_s, config.safety.valve_deadline_s
    if lifetime_s > valves.max_lifetime_s:
        yield (
            f"safety.setpoint_lifetime_s: {lifetime_s:g} s, but {place}.max_lifetime_s is "
            f"{valves.max_lifetime_s:g} s; write at most that"
        )
    least_s = TICKS_PER_LIFETIME / valves.rate_hz
    for name, seconds in (("setpoint_lifetime_s", lifetime_s), ("valve_deadline_s", deadline_s)):
        if seconds < least_s:
            yield (
                f"safety.{name}: {seconds:g} s is less than {TICKS_PER_LIFETIME} passes at {place}.rate_hz = "
                f"{valves.rate_hz:g}; write at least {least_s:g}, or raise that rate"
            )


def _slow_sensors(config: ServiceConfig, devices: Sequence[DriverConfig]) -> Iterator[str]:
    rates_hz = {device.name: getattr(device, "rate_hz", None) for device in devices}
    for index, sensor in enumerate(config.sensors):
        rate_hz, seconds = rates_hz.get(sensor.device), sensor.deadline_s
        if rate_hz is None or seconds is None:
            continue
        least_s = PERIODS_PER_READING / rate_hz
        if seconds < least_s:
            yield (
                f"sensors.{index}.deadline_s: {seconds:g} s is less than {PERIODS_PER_READING} readings of "
                f"{sensor.device!r} at {rate_hz:g} Hz; write at least {least_s:g}, or leave it out"
            )

"""How old the newest reading of a channel may be."""

from softarm.daemon.config import SensorSettings, Setup
from softarm.daemon.control.readings import channel
from softarm.drivers.config import DriverConfig

PERIODS = 3.0
"""A device that sends so slowly that the common deadline is less than this many periods gets these."""


def deadlines_s(setup: Setup) -> dict[str, float]:
    """Return the deadline of each channel that has its own [s].

    A sensor's ``deadline_s`` counts first. A gauge, which no mode needs, is late when its driver reports it.
    A device with a known rate may leave out two readings; for all others `safety.sensor_deadline_s` holds.
    """
    devices = {device.name: device for device in setup.devices}
    usual_s = setup.config.safety.sensor_deadline_s
    return {
        channel(sensor): _deadline_s(sensor, devices[sensor.device], usual_s)
        for sensor in setup.config.sensors
        if sensor.device in devices
    }


def _deadline_s(sensor: SensorSettings, device: DriverConfig, usual_s: float) -> float:
    if sensor.deadline_s is not None:
        return sensor.deadline_s
    if sensor.kind == "gauge":
        return max(usual_s, device.stale_after_s)
    rate_hz = getattr(device, "rate_hz", None)
    return usual_s if rate_hz is None else max(usual_s, PERIODS / float(rate_hz))

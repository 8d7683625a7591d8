"""Instruments that are unplugged, silent, given up, or whose readings cannot be taken."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.observation import DeviceStatus, ServiceHealth


def check_devices(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find what is wrong with each configured instrument; what the mode needs is judged by its inputs."""
    for device in observation.devices:
        if device.sink_errors:
            message = f"{device.sink_errors} of its readings could not be processed: an internal error"
            yield Diagnostic(
                "sink_failed", device.name, "warning", message, "report this with the service's log"
            )
        yield from _connection(device, observation)


def _connection(device: DeviceStatus, observation: ServiceHealth) -> Iterator[Diagnostic]:
    if device.gave_up:
        hint = f"{device.cure}; then command device/reconnect"
        yield Diagnostic(
            "device_gave_up", device.name, "warning", f"{device.error}; the service does not try again", hint
        )
    elif not device.connected and (device.error or not observation.settling):
        message = device.error or "is not connected yet"
        hint = device.cure or "check its cable, its power and its address"
        yield Diagnostic("device_lost", device.name, "warning", message, f"{hint}; the service keeps trying")
    elif device.connected and not device.measured and _silent(device) and not observation.settling:
        age = "no reading yet" if device.age_s is None else f"no valid reading for {device.age_s:.2f} s"
        message = f"{age}, while {observation.busy}" if observation.busy else age
        yield Diagnostic("device_silent", device.name, "warning", message, "check that it measures")


def _silent(device: DeviceStatus) -> bool:
    return device.age_s is None or device.age_s > device.deadline_s

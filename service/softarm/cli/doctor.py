"""``softarm doctor``: checks every configured device, and names the remedy of each fault."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from softarm.cli.output import PATH, NumberRange, json_option, progress, show
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Cell, Table
from softarm.daemon.config import ConfigError, load_config
from softarm.daemon.control.lateness import LATE_NS, STARVED_PERCENT, read_pressure
from softarm.drivers.clock import NANOSECONDS, PollTicker
from softarm.drivers.config import DriverConfig
from softarm.drivers.device import Device
from softarm.drivers.errors import DeviceError, DeviceErrors
from softarm.drivers.qualisys import discovery
from softarm.drivers.reading import Reading
from softarm.drivers.registry import load_devices
from softarm.drivers.supervisor import ALIVE, ConnectionState
from softarm.estimator.errors import InputError
from softarm.estimator.files import read_toml

TICK_NS = 20_000_000
LITTLE_ENDIAN = 1
"""What is added to a Qualisys base port for the little-endian protocol that the driver speaks."""
REMARKS = {
    "bad_checksum": ("frames with a wrong checksum", "check baud rate, cable and ground"),
    "malformed": ("frames that break the format", "check baud rate and protocol"),
    "gaps": ("samples that never arrived", "check the network and the load of the host"),
    "timeouts": ("requests without an answer in time", "check the network and the device's load"),
    "rejected": ("answers that did not fit", "check kind and firmware of the device"),
}


@dataclass
class CheckTally:
    """Counts what one device delivers.

    Attributes:
        readings: How many came.
        invalid: How many of them were invalid.
        first_ns: Host monotonic time of the first [ns].
        last_ns: Host monotonic time of the last [ns].
        transits_ns: From measurement to arrival, by the clock of a device that has one: least and most [ns].
        flags: Flags of the invalid ones.
    """

    readings: int = 0
    invalid: int = 0
    first_ns: int = 0
    last_ns: int = 0
    transits_ns: tuple[int, int] | None = None
    flags: set[str] = field(default_factory=set)

    def add(self, reading: Reading[Any]) -> None:
        """Count one reading."""
        if not self.readings:
            self.first_ns = reading.host_monotonic_ns
        self.last_ns = reading.host_monotonic_ns
        self.readings += 1
        self.invalid += not reading.valid
        if reading.device_time_ns is not None:
            transit_ns = reading.host_monotonic_ns - reading.measured_ns
            least_ns, most_ns = self.transits_ns or (transit_ns, transit_ns)
            self.transits_ns = min(least_ns, transit_ns), max(most_ns, transit_ns)
        self.flags.update(reading.flags)

    @property
    def late_ns(self) -> int:
        """How much later than the quickest the slowest reading arrived [ns]; 0 without a device's clock."""
        least_ns, most_ns = self.transits_ns or (0, 0)
        return most_ns - least_ns

    @property
    def rate_hz(self) -> float | None:
        """Readings per second; None with fewer than two."""
        span_ns = self.last_ns - self.first_ns
        return (self.readings - 1) * NANOSECONDS / span_ns if span_ns > 0 else None


@dataclass(frozen=True)
class DeviceNote:
    """One thing that is wrong, or worth a look.

    Attributes:
        device: The device.
        serious: Whether the device cannot be relied on.
        what: What was found.
        cure: What to do about it.
    """

    device: str
    serious: bool
    what: str
    cure: str


@dataclass(frozen=True)
class Examination:
    """What was found out about one device.

    Attributes:
        row: Its line in the table.
        findings: What is wrong with it.
        facts: What it reported of itself.
    """

    row: dict[str, Cell]
    findings: tuple[DeviceNote, ...]
    facts: dict[str, str]


@click.command()
@click.option(
    "--config", "path", type=PATH, help="A TOML file with [[devices]], such as the service's configuration."
)
@click.option(
    "--seconds",
    default=2.0,
    show_default=True,
    type=NumberRange(min=0.1, max=600.0),
    help="How long to listen to each device.",
)
@click.option(
    "--discover",
    metavar="ADDRESS[:PORT]",
    help="Only list the Qualisys hosts that answer at this address, such as a broadcast address.",
)
@json_option
def command(path: Path | None, seconds: float, discover: str | None, as_json: bool) -> int:
    """Check every configured device: does it answer, how fast, and with which fault.

    The arm does not move: the command writes no set-point and changes no setting. The exit status is 1
    when a device does not answer or reports a fault.

    Example: softarm doctor --config /etc/softarm/arm.toml

    Example: softarm doctor --discover 192.168.1.255
    """
    if (path is None) == (discover is None):
        raise click.UsageError("give either --config FILE or --discover ADDRESS")
    if path is None:
        assert discover is not None
        return _discover(discover, as_json=as_json)
    configs = read_devices(path)
    # What the drivers would log stands in the table.
    logging.getLogger("softarm.drivers").setLevel(logging.ERROR)
    with progress(f"Listening to {len(configs)} devices", seconds) as advance:
        examinations, busy = asyncio.run(examine_all(configs, seconds, advance))
    show(*tables(examinations, busy), as_json=as_json)
    return int(any(finding.serious for found in examinations for finding in found.findings))


def _discover(address: str, *, as_json: bool) -> int:
    """List the Qualisys hosts at an address; the status is 1 when none answers."""
    host, _, port = address.partition(":")
    number = int(port) if port.isdecimal() else 0 if port else discovery.DISCOVERY_PORT
    if not 1 <= number <= 65535:
        raise click.UsageError(f"the port in {address} is not a number from 1 to 65535")
    try:
        hosts = asyncio.run(discovery.discover(host, number))
    except OSError as error:
        raise WorkFailedError(f"{address} cannot be reached: {error.strerror or error}") from None
    rows: list[dict[str, Cell]] = [
        {"address": host.address, "port": host.base_port + LITTLE_ENDIAN, "host": host.description}
        for host in hosts
    ]
    show(Table("Qualisys hosts", rows, () if hosts else (f"None answered at {address}.",)), as_json=as_json)
    return int(not hosts)


def read_devices(path: Path) -> tuple[DriverConfig, ...]:
    """Read the ``[[devices]]`` of a configuration, which may have other tables or not.

    Raises:
        InputError: The file cannot be read, is not TOML, or has no devices.
        ConfigError: Its devices are wrong, or it is a configuration that the service refuses, all errors at
            once.
    """
    table, _ = read_toml(path, "give a configuration")
    if "specimen" in table:
        load_config(path)
    devices = table.get("devices")
    if not isinstance(devices, list) or not devices:
        raise InputError(str(path), "names no devices", "add [[devices]] with name and kind")
    try:
        return load_devices(devices)
    except DeviceErrors as error:
        raise ConfigError(path, error.lines()) from None


async def examine_all(
    configs: Sequence[DriverConfig], seconds: float, advance: Callable[[float], None]
) -> tuple[list[Examination], str]:
    """Examine devices side by side.

    Args:
        configs: The devices.
        seconds: How long to listen [s].
        advance: Called with the seconds that have passed.

    Returns:
        The examinations, and how the processor kept programs waiting meanwhile, in words.
    """
    late_ns = 0

    async def watch() -> None:
        nonlocal late_ns
        ticker = PollTicker(TICK_NS)
        while True:
            tick = await ticker.wait()
            late_ns = max(late_ns, tick.skipped * TICK_NS + tick.drift_ns)
            advance(TICK_NS / NANOSECONDS)

    clock = asyncio.create_task(watch())
    try:
        found = list(await asyncio.gather(*(examine(config, seconds) for config in configs)))
        return found, _busy(late_ns, read_pressure())
    finally:
        clock.cancel()
        await asyncio.gather(clock, return_exceptions=True)


def _busy(late_ns: int, starved_percent: float | None) -> str:
    """Describe how the processor kept this machine's programs waiting; empty when it did not."""
    if late_ns > LATE_NS:
        return f"doctor itself came {late_ns / 1e6:.0f} ms late"
    if starved_percent is not None and starved_percent > STARVED_PERCENT:
        return f"programs waited for the processor {starved_percent:.0f} % of the time"
    return ""


async def examine(config: DriverConfig, seconds: float) -> Examination:
    """Connect to one device, listen, and return what was found."""
    tally = CheckTally()
    device = config.build(tally.add, observe=True)
    try:
        await _listen(device, seconds)
        return describe(config, device, tally)
    finally:
        await device.close()


async def _listen(device: Device, seconds: float) -> None:
    try:
        await device.connect()
    except DeviceErrors as errors:
        if not any(error.retried for error in errors.leaves()):
            return
    await asyncio.sleep(seconds)


def describe(config: DriverConfig, device: Device, tally: CheckTally) -> Examination:
    """Return what was found out about a device at the end of the examination."""
    health = device.health
    round_trip = health.round_trip
    row: dict[str, Cell] = {
        "device": config.name,
        "kind": config.kind,
        "address": device.source,
        "state": str(_standing(device)),
        "rate_hz": tally.rate_hz,
        "readings": tally.readings,
        "invalid": tally.invalid,
        "round_trip_ms": round_trip.quantile_ns(0.5) / 1e6 if round_trip.count else None,
        "longest_gap_ms": health.interval.largest_ns / 1e6 if health.interval.count else None,
        "reconnects": health.reconnects,
    }
    return Examination(row, tuple(_findings(config.name, device, tally)), dict(health.facts))


def _standing(device: Device) -> ConnectionState:
    """Return the state; between two failed attempts that is a fault."""
    return device.state if device.state in ALIVE or not device.health.failures else ConnectionState.FAULT


def _findings(name: str, device: Device, tally: CheckTally) -> list[DeviceNote]:
    health = device.health
    found = []
    if device.state not in ALIVE:
        found.append(_of_error(name, health.last_error))
    elif not tally.readings:
        found.append(DeviceNote(name, True, "answers, but sends no reading", "start its measurement"))
    for alarm in health.alarms.active:
        quantity = "" if alarm.value is None else f" ({alarm.value} {alarm.unit}".rstrip() + ")"
        found.append(DeviceNote(name, True, f"{alarm.what}{quantity}", alarm.cure))
    if tally.invalid:
        reasons = ", ".join(sorted(tally.flags)) or "no reason given"
        found.append(
            DeviceNote(name, False, f"{tally.invalid} invalid readings: {reasons}", "see the device's page")
        )
    if tally.late_ns > LATE_NS:
        late = f"readings came up to {tally.late_ns / 1e6:.0f} ms late, by the device's own clock"
        found.append(
            DeviceNote(name, False, late, "reduce the load on the sending host, the network, or this host")
        )
    for counter, (what, cure) in REMARKS.items():
        if count := getattr(health, counter):
            found.append(DeviceNote(name, False, f"{count} {what}", cure))
    return found


def _of_error(name: str, error: DeviceError | None) -> DeviceNote:
    if error is None:
        return DeviceNote(name, True, "does not answer", "check cable, address and power")
    what = str(error).removeprefix(f"{error.device}: ").removesuffix(f"; {error.cure}")
    return DeviceNote(name, True, what, error.cure)


def tables(examinations: Sequence[Examination], busy: str = "") -> list[Table]:
    """Arrange the examinations: the devices, their faults, and their status.

    Args:
        examinations: What was found.
        busy: How the processor kept this machine's programs waiting, in words; empty when it did not.
    """
    findings = [finding for found in examinations for finding in found.findings]
    rows: list[dict[str, Cell]] = [
        {
            "device": finding.device,
            "level": "fault" if finding.serious else "remark",
            "finding": finding.what,
            "remedy": finding.cure,
        }
        for finding in findings
    ]
    facts: list[dict[str, Cell]] = [
        {"device": str(found.row["device"]), "fact": key, "value": value}
        for found in examinations
        for key, value in found.facts.items()
    ]
    serious = sum(any(finding.serious for finding in found.findings) for found in examinations)
    note = f"{len(examinations) - serious} of {len(examinations)} devices work. No set-point was written."
    notes = (note, f"This machine is busy: {busy}. This load may be why devices seem late or silent.")
    laid_out = [Table("Devices", [found.row for found in examinations], notes if busy else (note,))]
    if rows:
        laid_out.append(Table("Findings", rows))
    if facts:
        laid_out.append(Table("Device status", facts))
    return laid_out

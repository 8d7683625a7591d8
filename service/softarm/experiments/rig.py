"""A rig of fakes and a service on them, each a process of its own: for demo, experiments and benches."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import tomli_w

from softarm.common.real_time import raise_priority
from softarm.daemon.config import SafetySettings
from softarm.daemon.consistency import PLACED
from softarm.drivers.valves.config import ValveConfig
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen

END_TIMEOUT_S = 25.0
UNIT_NICENESS = -10
"""That of the service's systemd unit."""
PATIENCE = 10.0
"""Of an experiment on fakes, which share the machine with the service and with everything else."""
WAITS = ("valve_deadline_s", "sensor_deadline_s", "setpoint_lifetime_s", "lease_s", "estimator_deadline_s")
"""Settings of the service that state how long another process may be silent."""
VALVE_WAITS = ("watchdog_ms", "echo_lag_s", "lost_after_misses", "stale_after_s")
"""Settings of a valve terminal that state how long it or its host may be silent."""
EXTRA: Mapping[str, Mapping[str, Any]] = {
    "sauter": {"unit": "N"},
    "witmotion": {"rate_hz": 50},
    "quaternion_line": {"unit": 2, "rate_hz": 8},
}
"""Settings of a driver for a fake, beside its address."""
INERTIAL = ("bno08x_rvc", "witmotion", "xbus", "quaternion_line")


@dataclass(frozen=True)
class RigSettings:
    """What to start.

    Args:
        scenario: Scenario of the fakes: a file, or the name of a shipped one.
        specimen: Specimen that the service runs on.
        arm: Name of the arm on the network.
        endpoint: zenoh endpoint of the service.
        model: What the estimator runs on.
        rate_hz: Rate of the control loop.
        sensors: Kinds of sensors that the estimator may use: ``orientation`` or ``pose`` of motion capture,
            ``bend``, ``imu``.
        forces_on: Sections on which a force may act; all that move when empty.
        variant: Which arm is drawn, with tolerances of its own; that of the scenario when left out.
        patience: Factor on how long devices, clients and the estimator may be silent: more than 1 where
            fakes share a busy machine with the service.
    """

    scenario: str | Path
    specimen: str = "sopra"
    arm: str = "sopra"
    endpoint: str = "tcp/127.0.0.1:7447"
    model: str = "fem"
    rate_hz: float = 100.0
    sensors: tuple[str, ...] = ("orientation",)
    forces_on: tuple[str, ...] = ()
    variant: int | None = None
    patience: float = 1.0


@contextmanager
def niceness(wanted: int) -> Iterator[None]:
    """Start processes with a niceness, where that is permitted; this one keeps its own."""
    present = os.getpriority(os.PRIO_PROCESS, 0)
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, wanted)
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, present)


def free_endpoint() -> str:
    """Name a zenoh endpoint on this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def service_config(settings: RigSettings, devices: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Write the configuration of a service for running fakes.

    Args:
        settings: What to start.
        devices: The devices that the fakes reported when they were ready.

    Returns:
        The configuration as a table.
    """
    tables, sensors, usual = [], [], SafetySettings().model_dump()
    specimen = load_specimen(settings.specimen)
    limit_pa = min(specimen.pressure_limits)
    tip = specimen.sections[-1].name
    for device in devices:
        tables.append(_device_table(device, settings.patience, limit_pa))
        sensors += _sensor_tables(device, settings.sensors, tip)
    return {
        "arm": settings.arm,
        "specimen": settings.specimen,
        "base_body": next(
            (f"{d['name']}/{d['sections'][0]}" for d in devices if d["kind"] == "qualisys"), ""
        ),
        "network": {"listen": [settings.endpoint]},
        "control": {
            "model": settings.model,
            "rate_hz": settings.rate_hz,
            "forces_on": list(settings.forces_on),
        },
        "safety": {name: settings.patience * usual[name] for name in WAITS},
        "devices": tables,
        "sensors": _first_of_each(sensors),
    }


def _first_of_each(sensors: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Keep one sensor of each quantity on each section: the service accepts no more."""
    chosen: dict[tuple[str, str], dict[str, Any]] = {}
    for sensor in sensors:
        quantity = "frame" if sensor["kind"] in PLACED else sensor["kind"]
        chosen.setdefault((quantity, sensor["section"]), sensor)
    return list(chosen.values())


def _device_table(device: Mapping[str, Any], patience: float, limit_pa: float) -> dict[str, Any]:
    table: dict[str, Any] = {"name": device["name"], "kind": device["kind"], "simulated": True}
    if device["kind"] in ("festo_mpa", "festo_vtem"):
        return table | {
            "host": device["host"],
            "port": device["port"],
            "chambers": list(device["valve_map"]),
            "maximum_pa": limit_pa,
            **{name: type(usual)(patience * usual) for name, usual in _valve_waits().items()},
        }
    if device["kind"] == "qualisys":
        return table | {"host": device["host"], "port": device["port"]}
    if device["kind"] == "bendlabs":
        return table | {"port": device["path"], "sensors": len(device["sections"])}
    return table | {"port": device["path"], **EXTRA.get(device["kind"], {})}


def _valve_waits() -> dict[str, Any]:
    return {name: ValveConfig.model_fields[name].default for name in VALVE_WAITS}


def _sensor_tables(device: Mapping[str, Any], kinds: Sequence[str], tip: str) -> list[dict[str, Any]]:
    name, kind = device["name"], device["kind"]
    if kind == "qualisys":
        chosen = "pose" if "pose" in kinds else "orientation"
        if chosen not in kinds:
            return []
        return [
            {"kind": chosen, "section": section, "device": name, "channel": section, "needed": True}
            for section in device["sections"][1:]
        ]
    if kind == "bendlabs" and "bend" in kinds:
        return [
            {"kind": "bend", "section": section, "device": name, "channel": str(index)}
            for index, section in enumerate(device["sections"])
            if section
        ]
    if kind in INERTIAL and "imu" in kinds:
        return [{"kind": "orientation", "section": device["sections"][-1], "device": name}]
    if kind in ("lutron", "mark10", "sauter", "line_gauge"):
        return [{"kind": "gauge", "section": tip, "device": name}]
    return []


class Process:
    """A command of ours as a process; it ends with the block.

    Args:
        arguments: Words after ``softarm``.
        log: File for its standard error.
    """

    def __init__(self, arguments: Sequence[str], log: Path) -> None:
        self._arguments = [sys.executable, "-m", "softarm", *arguments]
        self._log = log
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        with self._log.open("a") as log:
            self._process = subprocess.Popen(self._arguments, stdout=subprocess.PIPE, stderr=log, text=True)
        return self

    @property
    def process(self) -> subprocess.Popen[str]:
        """The running process."""
        assert self._process is not None
        return self._process

    def first_line(self) -> str:
        """Wait for the first line that it prints.

        Raises:
            InputError: It ended without one.
        """
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            lines = self._log.read_text().strip().splitlines()[-1:] or ["no message"]
            raise InputError(
                f"softarm {self._arguments[3]}", f"ended at once ({lines[0]})", f"see {self._log}"
            )
        return line

    def end(self, number: int = signal.SIGTERM) -> int:
        """Send a signal and wait for the end; killed when it does not come."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def __exit__(self, *_: object) -> None:
        self.end()
        if self.process.stdout is not None:
            self.process.stdout.close()


class FakeRig:
    """Fakes and a service on them, running within the block.

    Args:
        settings: What to start.
        folder: Folder of the configuration, the logs, the state and the recordings.
    """

    def __init__(self, settings: RigSettings, folder: Path) -> None:
        self.settings = settings
        self.folder = folder
        self.config_path = folder / "service.toml"
        arm = ["--specimen", settings.specimen]
        if settings.variant is not None:
            arm += ["--variant", str(settings.variant)]
        self.fakes = Process(
            ("fakes", "--scenario", str(settings.scenario), *arm, "--json"), folder / "fakes.log"
        )
        self.service = Process(
            ("serve", "--config", str(self.config_path), "--verbose"), folder / "service.log"
        )
        self.announcement: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        with niceness(UNIT_NICENESS):  # devices are never late, so the fakes have it as well
            self.fakes.__enter__()
        try:
            self.announcement = json.loads(self.fakes.first_line())
            raise_priority(self.fakes.process.pid)
            table = service_config(self.settings, self.announcement["devices"])
            self.config_path.write_text(tomli_w.dumps(table))
            with niceness(UNIT_NICENESS):
                self.service.__enter__()
        except BaseException:
            self.fakes.end()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.service.__exit__(*error)
        self.fakes.__exit__(*error)

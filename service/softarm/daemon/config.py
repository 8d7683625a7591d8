"""The configuration of one service: a TOML file, checked as a whole."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from softarm.daemon.consistency import inconsistencies
from softarm.daemon.settings import (
    ControlSettings,
    PageSettings,
    SafetySettings,
    SensorSettings,
    ServiceConfig,
)
from softarm.daemon.unit import UNIT_FOLDERS, state_directory, zenoh_credential
from softarm.drivers.config import DriverConfig
from softarm.drivers.errors import DeviceErrors
from softarm.drivers.registry import load_devices
from softarm.drivers.valves.config import ValveConfig
from softarm.estimator.errors import InputError, suggest
from softarm.estimator.files import read_toml
from softarm.estimator.specimen import Specimen, load_specimen
from softarm_client.session import NetworkSettings

__all__ = [
    "ConfigError",
    "ControlSettings",
    "SafetySettings",
    "SensorSettings",
    "ServiceConfig",
    "Setup",
    "load_config",
]


@dataclass(frozen=True)
class Setup:
    """A checked configuration with what it names loaded."""

    path: Path
    text: str
    config: ServiceConfig
    specimen: Specimen
    devices: tuple[DriverConfig, ...]

    @property
    def pressure_limits(self) -> tuple[float, ...]:
        """Highest gauge pressure of each chamber [Pa]: the lower of the specimen's and the valves'."""
        limits: tuple[float, ...] = tuple(self.specimen.pressure_limits)
        for device in self.devices:
            if isinstance(device, ValveConfig):
                limits = tuple(map(min, limits, device.maximum))
        return limits


class ConfigError(InputError):
    """Every error of a configuration, numbered, in one line.

    Args:
        path: The file.
        lines: The errors, each with its path in the file.
    """

    def __init__(self, path: Path, lines: list[str]) -> None:
        listed = "; ".join(f"({number}) {line}" for number, line in enumerate(lines, 1))
        one = len(lines) == 1
        super().__init__(str(path), lines[0] if one else listed, "correct it" if one else "correct them all")
        self.lines = lines


def load_config(path: Path) -> Setup:
    """Read and check a configuration.

    Args:
        path: The TOML file; relative paths in it start at its folder.

    Returns:
        The configuration with its specimen and devices.

    Raises:
        InputError: The file cannot be read or is not TOML.
        ConfigError: Every error at once, each with its path.
    """
    document, text = read_toml(path)
    document.setdefault("arm", path.stem)
    # Every part is checked for itself, so that one wrong field does not hide the errors of the others.
    errors: list[str] = []
    config = _validated(document, errors)
    devices = _devices(document, errors)
    specimen = _specimen(document, path.parent, errors)
    errors += _inconsistencies(document, specimen)
    if config is not None and specimen is not None:
        config = _rooted(config, path.absolute().parent)
        errors += inconsistencies(config, specimen, devices)
    if errors or config is None or specimen is None:
        raise ConfigError(path, errors)
    return Setup(path, text, config, specimen, devices)


def _validated(document: Mapping[str, Any], errors: list[str]) -> ServiceConfig | None:
    try:
        return ServiceConfig.model_validate(document)
    except ValidationError as error:
        errors += [_error_line(entry) for entry in error.errors()]
        return None


def _error_line(entry: Any) -> str:
    place = ".".join(str(part) for part in entry["loc"])
    if entry["type"] == "extra_forbidden":
        known = _known_keys(entry["loc"][:-1])
        advice = suggest(str(entry["loc"][-1]), known, f"known keys: {', '.join(known)}", cutoff=0.6)
        return f"{place}: unknown key; {advice}"
    if entry["type"] == "missing":
        return f"{place}: missing; add it"
    return f"{place}: {entry['msg']} (got {entry['input']!r})"


def _known_keys(place: tuple[str | int, ...]) -> tuple[str, ...]:
    tables: dict[str, type[BaseModel]] = {
        "network": NetworkSettings,
        "page": PageSettings,
        "control": ControlSettings,
        "safety": SafetySettings,
        "sensors": SensorSettings,
    }
    model = tables.get(str(place[0]), ServiceConfig) if place else ServiceConfig
    return tuple(model.model_fields)


def _devices(document: Mapping[str, Any], errors: list[str]) -> tuple[DriverConfig, ...]:
    tables = document.get("devices", ())
    if not isinstance(tables, list):
        return ()
    try:
        return load_devices(tables)
    except DeviceErrors as wrong:
        errors += wrong.lines()
        return ()


def _specimen(document: Mapping[str, Any], folder: Path, errors: list[str]) -> Specimen | None:
    name = document.get("specimen")
    if not isinstance(name, str):
        return None
    local = folder / name
    try:
        return load_specimen(local if local.is_file() else name)
    except InputError as error:
        errors.append(f"specimen: {error}")
        return None


def _inconsistencies(document: Mapping[str, Any], specimen: Specimen | None) -> Iterator[str]:
    """Find names that mean nothing, whatever else is wrong with the document."""
    devices = {str(table.get("name")) for table in _tables(document.get("devices"))}
    base = document.get("base_body")
    if isinstance(base, str) and base and base.split("/")[0] not in devices:
        yield f"base_body: no device {base.split('/')[0]!r}; write device/body"
    for index, sensor in enumerate(_tables(document.get("sensors"))):
        if "device" in sensor and sensor["device"] not in devices:
            listed = ", ".join(sorted(devices)) or "none"
            yield f"sensors.{index}.device: no device {sensor['device']!r}; there are {listed}"
        sections = [] if specimen is None else sorted(section.name for section in specimen.sections)
        if sections and "section" in sensor and sensor["section"] not in sections:
            listed = ", ".join(sections)
            yield f"sensors.{index}.section: no section {sensor['section']!r}; there are {listed}"
    if specimen is not None:
        yield from _unmoved(document.get("control"), specimen)


def _unmoved(control: Any, specimen: Specimen) -> Iterator[str]:
    """Find forces on sections that cannot move."""
    moving = [s.name for s in specimen.sections if s.frame_origin_m[2] > specimen.clamp.up_to_m]
    forces = control.get("forces_on") if isinstance(control, dict) else None
    for index, section in enumerate(forces if isinstance(forces, list) else ()):
        if section not in moving:
            yield f"control.forces_on.{index}: {section!r} does not move; {', '.join(moving)} do"


def _tables(value: Any) -> list[dict[str, Any]]:
    """Return the tables of a list; what is none is reported elsewhere."""
    return [table for table in value if isinstance(table, dict)] if isinstance(value, list) else []


def _rooted(config: ServiceConfig, folder: Path) -> ServiceConfig:
    """Resolve paths; those that are left out are the unit's, where systemd starts the service."""
    state, configured = state_directory(), config.model_fields_set
    folders = {
        name: state / default if state and name not in configured else folder / getattr(config, name)
        for name, default in UNIT_FOLDERS.items()
    }
    network = config.network.relative_to(folder)
    if network.zenoh_config is None:
        network = network.model_copy(update={"zenoh_config": zenoh_credential()})
    return config.model_copy(update={**folders, "network": network})

"""Every kind of device, and the configuration file that names those of one arm."""

import difflib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from softarm.drivers.bend.device import BendConfig
from softarm.drivers.config import DriverConfig
from softarm.drivers.errors import ConfigurationError, DeviceError, DeviceErrors
from softarm.drivers.gauges.device import LineGaugeConfig, LutronConfig
from softarm.drivers.gauges.polled import Mark10Config, SauterConfig
from softarm.drivers.imu.device import Bno08xConfig, QuaternionLineConfig, XbusConfig
from softarm.drivers.imu.wit_device import WitConfig
from softarm.drivers.qualisys.device import QualisysConfig
from softarm.drivers.valves.bank import MpaConfig, VtemConfig

KINDS: dict[str, type[DriverConfig]] = {
    "festo_mpa": MpaConfig,
    "festo_vtem": VtemConfig,
    "qualisys": QualisysConfig,
    "lutron": LutronConfig,
    "line_gauge": LineGaugeConfig,
    "mark10": Mark10Config,
    "sauter": SauterConfig,
    "bendlabs": BendConfig,
    "bno08x_rvc": Bno08xConfig,
    "witmotion": WitConfig,
    "xbus": XbusConfig,
    "quaternion_line": QuaternionLineConfig,
}
"""Kind as the configuration names it, to the model of its driver."""


def load_devices(tables: Sequence[Mapping[str, Any]], where: str = "devices") -> tuple[DriverConfig, ...]:
    """Check the ``[[devices]]`` tables of a configuration.

    Args:
        tables: The tables, as `tomllib` reads them.
        where: File and field, for errors.

    Returns:
        One configuration per device, in order.

    Raises:
        DeviceErrors: Every error at once, each with its device and field.
    """
    errors: list[DeviceError] = []
    devices: list[DriverConfig] = []
    for index, table in enumerate(tables):
        place = f"{where}[{index}]"
        try:
            devices.append(_load(table, place))
        except DeviceErrors as error:
            errors.extend(error.leaves())
    errors.extend(_doubles(devices, where))
    if errors:
        raise DeviceErrors(f"{where} cannot be used", errors)
    return tuple(devices)


def _load(table: Mapping[str, Any], place: str) -> DriverConfig:
    if not isinstance(table, Mapping):
        raise _single(place, "is not a table", "write [[devices]] with name and kind")
    kind = table.get("kind")
    model = KINDS.get(str(kind))
    if model is None:
        near = difflib.get_close_matches(str(kind), KINDS, n=1)
        hint = f"; nearest is {near[0]!r}" if near else ""
        raise _single(place, f"kind {kind!r} is unknown{hint}", f"use one of {', '.join(sorted(KINDS))}")
    named = f"{place} ({table.get('name', kind)})"
    try:
        return model.model_validate(dict(table))
    except ValidationError as error:
        raise DeviceErrors(named, [_field_error(named, model, entry) for entry in error.errors()]) from None


def _field_error(place: str, model: type[DriverConfig], entry: Any) -> ConfigurationError:
    field = ".".join(str(part) for part in entry["loc"])
    where = f"{place}.{field}" if field else place
    if entry["type"] == "extra_forbidden":
        near = difflib.get_close_matches(field, model.model_fields, n=1)
        names = f"nearest known is {near[0]!r}" if near else f"known are {', '.join(model.model_fields)}"
        return ConfigurationError(where, "is not known", f"remove or rename it; {names}")
    if entry["type"] == "missing":
        return ConfigurationError(where, "is missing", "add it")
    message = str(entry["msg"]).removeprefix("Value error, ")
    value = entry["input"] if isinstance(entry["input"], (int, float, str)) else None
    return ConfigurationError(where, message[:1].lower() + message[1:], "correct it", value=value)


def _doubles(devices: Sequence[DriverConfig], where: str) -> list[ConfigurationError]:
    counts = Counter(device.name for device in devices)
    return [
        ConfigurationError(where, f"{count} devices are named {name!r}", "give each its own name")
        for name, count in counts.items()
        if count > 1
    ]


def _single(place: str, what: str, cure: str) -> DeviceErrors:
    return DeviceErrors(place, [ConfigurationError(place, what, cure)])

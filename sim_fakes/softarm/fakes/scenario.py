"""Scenario files: which fakes there are, how they are, and what goes wrong when."""

import difflib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from softarm.estimator.errors import InputError
from softarm.estimator.files import parse_toml
from softarm.fakes.parts import (
    PART_OF_KIND,
    AnyDevice,
    BodyPart,
    ConfigTable,
    NotNegative,
    Port,
    Positive,
    ValvesPart,
    Vector,
)

Parameter = bool | int | float | str
SHIPPED = ("demo", "bench", "bad_day")


class PlantPart(ConfigTable):
    """The arm.

    Attributes:
        kind: ``arm`` for the dynamic one, ``still`` for the one without dynamics.
        specimen: Specimen whose arm to simulate, a file or the name of a shipped one; SoPrA when left out.
        variant: Seed that draws another arm of the same design, with the misalignment of its bodies of
            motion capture; the drawing itself when left out.
        switches: Concealed effects that are on from the start, name to value.
    """

    kind: Literal["arm", "still"] = "arm"
    specimen: str | None = None
    variant: Annotated[int, Field(ge=0)] | None = None
    switches: Annotated[dict[str, Any], Field(default_factory=dict)]


class FaultPart(ConfigTable):
    """A scripted fault.

    Attributes:
        at_s: When it begins [s].
        device: Name of the device.
        fault: Name of the fault.
        for_s: How long a lasting fault stays [s]; to the end when left out.
        times: How often a fault that acts once is to act.
        parameters: Parameters that differ from their defaults.
    """

    at_s: NotNegative
    device: str
    fault: str
    for_s: Positive | None = None
    times: Annotated[int, Field(ge=1)] = 1
    parameters: Annotated[dict[str, Parameter], Field(default_factory=dict)]


class CordPart(ConfigTable):
    """The cord to the force gauge: section, hook in the laboratory frame [m], length [m]."""

    section: str
    hook_m: Vector
    length_m: NotNegative


class Scenario(ConfigTable):
    """A rig of fakes.

    Attributes:
        name: What it is called.
        seed: Seed of everything random.
        step_s: Step of the world [s].
        host: Address that TCP and UDP ports listen on.
        control_port: TCP port of the control interface, 0 for a free one; left out for none.
        runtime_dir: Folder of the links to the serial terminals; a fresh one when left out.
        plant: The arm.
        cord: The cord that is tied at the start.
        device: The devices.
        fault: The scripted faults.
    """

    name: str = "bench"
    seed: Annotated[int, Field(ge=0)] = 1
    step_s: Annotated[float, Field(gt=0, le=0.02)] = 0.002
    host: str = "127.0.0.1"
    control_port: Port | None = 0
    runtime_dir: Path | None = None
    plant: PlantPart = PlantPart(switches={})
    cord: CordPart | None = None
    device: Annotated[tuple[Annotated[AnyDevice, Field(discriminator="kind")], ...], Field(min_length=1)]
    fault: tuple[FaultPart, ...] = ()

    @model_validator(mode="after")
    def _fits_together(self) -> "Scenario":
        names = [device.name for device in self.device]
        errors = [f"two devices are named {name!r}" for name in sorted(set(names)) if names.count(name) > 1]
        errors += [
            f"fault.{k}.device: no device {fault.device!r}"
            for k, fault in enumerate(self.fault)
            if fault.device not in names
        ]
        if sum(isinstance(device, ValvesPart) for device in self.device) > 1:
            errors.append("there are two valve terminals")
        if errors:
            raise ValueError("; ".join(errors))
        return self


def read_scenario(source: str | Path) -> Scenario:
    """Read and check a scenario.

    Args:
        source: Path of a TOML file, or the name of a shipped scenario.

    Raises:
        InputError: It cannot be read, or something in it is wrong; every error is named.
    """
    shipped = resources.files("softarm.fakes") / "scenarios" / f"{source}.toml"
    file = shipped if str(source) in SHIPPED else Path(source)
    try:
        data = file.read_bytes()
    except OSError as error:
        advice = f"give a scenario file or one of {', '.join(SHIPPED)}"
        raise InputError(str(source), f"cannot be read ({error.strerror})", advice) from None
    return check_scenario(parse_toml(str(source), data), str(source))


def check_scenario(table: dict[str, Any], where: str = "scenario") -> Scenario:
    """Check a scenario given as a table.

    Raises:
        InputError: Something in it is wrong; every error is named.
    """
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        entries = error.errors()
        counted = [entry for entry in entries if entry["type"] != "too_short" or len(entries) == 1]
        errors = "; ".join(map(_error_line, counted))
        raise InputError(where, errors, "correct these, the keys are in docs/fakes.md") from None


def _error_line(entry: Any) -> str:
    words = [str(word) for word in entry["loc"]]
    place = ".".join(word for word in words if word not in PART_OF_KIND)
    if entry["type"] == "extra_forbidden":
        return f"{place}: unknown key{_near(words)}"
    message = str(entry["msg"]).removeprefix("Value error, ")
    return f"{place}: {message[:1].lower()}{message[1:]}" if place else message


def _near(words: Sequence[str]) -> str:
    """Name the known key that is nearest to an unknown one."""
    part = PART_OF_KIND.get(words[-2]) if len(words) > 1 else Scenario
    tables: list[type[ConfigTable]] = [part] if part else [PlantPart, CordPart, FaultPart, BodyPart]
    keys = {key for table in tables for key in table.model_fields}
    close = difflib.get_close_matches(words[-1], keys, n=1)
    return f", did you mean {close[0]!r}?" if close else ""

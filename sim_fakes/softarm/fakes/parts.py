"""The table of each kind of device in a scenario file, with its defaults."""

from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Port = Annotated[int, Field(ge=0, le=65535)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


class ConfigTable(BaseModel):
    """A table of the file; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class DevicePart(ConfigTable):
    """What every device has: a name and a kind."""

    name: Name
    kind: str


class ValvesPart(DevicePart):
    """A valve terminal.

    Attributes:
        port: TCP port, 0 for a free one.
        valve_map: Valve of each chamber.
        watchdog_ms: Time-out of the Modbus connection at power-on [ms], 0 for none.
        max_clients: Connections it accepts; the next one is closed at once.
        supply_pa: Supply pressure [Pa].
        dead_time_s: Shortest and longest dead time of its regulators [s].
        fill_time_s: Time constant of filling [s].
        bias_pa: Smallest and largest steady shortfall [Pa].
        noise_pa: Noise of its readings [Pa].
    """

    kind: Literal["festo_mpa", "festo_vtem"]
    port: Port = 0
    valve_map: Annotated[tuple[Annotated[int, Field(ge=0, le=15)], ...], Field(min_length=1)] = (
        0,
        1,
        2,
        3,
        4,
        5,
    )
    watchdog_ms: Annotated[int, Field(ge=0, le=65535)] = 0
    max_clients: Annotated[int, Field(ge=1)] = 10
    supply_pa: Positive = 250e3
    dead_time_s: tuple[NotNegative, NotNegative] = (0.04, 0.06)
    fill_time_s: Positive = 0.07
    bias_pa: tuple[Finite, Finite] = (500.0, 900.0)
    noise_pa: NotNegative = 15.0

    @model_validator(mode="after")
    def _one_valve_each(self) -> "ValvesPart":
        if len(set(self.valve_map)) < len(self.valve_map):
            raise ValueError("valve_map names a valve twice")
        return self


class BodyPart(ConfigTable):
    """A rigid body of the motion capture.

    Attributes:
        name: Its name in QTM.
        section: Section that carries it.
        offset_m: Its origin in the section's frame [m].
        rotation_rad: Its axes in the section's frame, a rotation vector [rad].
    """

    name: str
    section: str
    offset_m: Vector = (0.0, 0.0, 0.0)
    rotation_rad: Vector = (0.0, 0.0, 0.0)


class QtmPart(DevicePart):
    """Qualisys Track Manager.

    Attributes:
        port: Little-endian TCP port, 0 for a free one.
        discovery_port: UDP port on which it can be discovered, 0 for a free one; left out for none.
        rate_hz: Camera rate [Hz].
        bodies: Rigid bodies in the order of the project.
        newest_version: Newest protocol version it speaks.
        password: Password of client control.
        latency_s: From exposure to the wire [s].
        position_noise_m: Noise of a coordinate [m].
        angle_noise_rad: Noise of an angle [rad].
        clock_ppm: How much too fast the camera clock runs.
    """

    kind: Literal["qualisys"]
    port: Port = 0
    discovery_port: Port | None = None
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    bodies: tuple[BodyPart, ...] = (
        BodyPart(name="base", section="base"),
        BodyPart(name="intermediate", section="intermediate"),
        BodyPart(name="tip", section="tip"),
    )
    newest_version: Annotated[str, Field(pattern=r"^1\.\d{1,2}$")] = "1.25"
    password: str = ""
    latency_s: NotNegative = 4e-3
    position_noise_m: NotNegative = 3e-5
    angle_noise_rad: NotNegative = 3e-4
    clock_ppm: Finite = 0.0


class SerialPart(DevicePart):
    """A device on a serial line.

    Attributes:
        link: Path of the symbolic link to its terminal; in the runtime directory under its name if left out.
    """

    link: Path | None = None


class GaugePart(SerialPart):
    """A force gauge.

    Attributes:
        full_scale_n: Largest load [N].
        noise_n: Noise of a reading [N].
        drift_n_per_s: Drift of its zero [N/s].
    """

    full_scale_n: Positive = 49.03325
    noise_n: NotNegative = 0.004
    drift_n_per_s: Finite = 0.0


class LutronPart(GaugePart):
    """Lutron gauge: 16-digit stream."""

    kind: Literal["lutron"]
    rate_hz: Annotated[float, Field(gt=0, le=60)] = 20.0
    unit: Literal["g", "kg", "N", "lb", "oz"] = "g"
    baud: int = 9600


class Mark10Part(GaugePart):
    """Mark-10 gauge: GCL2 commands."""

    kind: Literal["mark10"]
    unit: Literal["N", "KN", "MN", "LB", "OZ", "KG", "G"] = "N"
    baud: int = 115200


class SauterPart(GaugePart):
    """Sauter FH gauge: reading on request."""

    kind: Literal["sauter"]
    baud: int = 9600


class LineGaugePart(GaugePart):
    """Home-made gauge: a number per line.

    Attributes:
        rate_hz: Lines per second: 10 or 80 on an HX711.
        unit: Unit of the number.
        decimals: Digits after the point.
        prints_unit: Whether the unit stands behind the number.
        baud: Speed of the line [bit/s].
    """

    kind: Literal["line_gauge"]
    rate_hz: Positive = 80.0
    unit: Literal["g", "kg", "N", "mN", "lb", "oz"] = "g"
    decimals: Annotated[int, Field(ge=0, le=6)] = 1
    prints_unit: bool = True
    baud: int = 115200


class BendPart(SerialPart):
    """The lab's board with BendLabs sensors.

    Attributes:
        sensors: Segment under each sensor, distal first; "" for a sensor that lies on the bench.
        rate_hz: Lines per second.
        noise_rad: Noise before the filter [rad].
        boot_s: Silence after power-on [s].
        resets_on_open: Whether it boots when a host opens the port, as an Uno or Mega does.
    """

    kind: Literal["bendlabs"]
    sensors: Annotated[tuple[str, ...], Field(min_length=1)] = ("lower", "upper", "")
    rate_hz: Positive = 90.0
    noise_rad: NotNegative = 2e-3
    boot_s: NotNegative = 1.5
    resets_on_open: bool = False
    baud: int = 115200


class InertialPart(SerialPart):
    """An inertial unit.

    Attributes:
        section: Section that carries it.
        rotation_rad: Its axes in the section's frame, a rotation vector [rad].
        noise_rad: Noise of an angle [rad].
        drift_rad_per_s: Drift of its heading [rad/s].
    """

    section: str = "tip"
    rotation_rad: Vector = (0.0, 0.0, 0.0)
    noise_rad: NotNegative = 1e-3
    drift_rad_per_s: Finite = 1.45e-4


class BnoPart(InertialPart):
    """BNO08x in UART-RVC mode."""

    kind: Literal["bno08x_rvc"]
    rate_hz: Positive = 100.0
    baud: int = 115200


class WitMotionPart(InertialPart):
    """WitMotion module; ``needs_unlock``: commands count only within 10 s of the unlock command."""

    kind: Literal["witmotion"]
    baud: int = 9600
    needs_unlock: bool = True


class XbusPart(InertialPart):
    """Xsens module on Xbus; ``clock_ppm``: how much too fast its clock runs."""

    kind: Literal["xbus"]
    rate_hz: Positive = 100.0
    clock_ppm: Finite = 20.0
    baud: int = 115200


class QuaternionLinePart(InertialPart):
    """The lab's sketch with BNO055 sensors; ``sections``: what carries each sensor, sensor 1 first."""

    kind: Literal["quaternion_line"]
    sections: Annotated[tuple[str, ...], Field(min_length=1)] = ("intermediate", "tip")
    rate_hz: Positive = 8.0
    baud: int = 9600


AnyDevice = (
    ValvesPart | QtmPart | LutronPart | Mark10Part | SauterPart | LineGaugePart | BendPart | BnoPart
    | WitMotionPart | XbusPart | QuaternionLinePart
)  # fmt: skip
PART_OF_KIND: dict[str, type[DevicePart]] = {
    kind: part for part in get_args(AnyDevice) for kind in get_args(part.model_fields["kind"].annotation)
}

"""The tables of a service's configuration and their defaults."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from softarm_client.session import NetworkSettings

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$", max_length=40)]


class StrictTable(BaseModel):
    """What every table of the configuration is: frozen, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class ControlSettings(StrictTable):
    """The ``[control]`` table."""

    rate_hz: Positive = 100.0
    """Rate of the control loop."""
    model: Literal["fem", "rod"] = "fem"
    """Model of the estimator: the converged finite elements or the calibrated rod."""
    forces_on: tuple[str, ...] = ()
    """Sections on which an external force may act; all that move when left out."""
    load_std_n: Positive = 1.0
    """Expected size of forces; much larger ones are estimated with a delay."""
    load_time_constant_s: Positive = 1.0
    """How fast external forces change."""
    hold_rate_per_s: Positive = 0.6
    """Gain of the feedback that holds a pose."""
    hold_authority_pa: Positive = 15e3
    """Largest correction of a chamber by that feedback."""


class SafetySettings(StrictTable):
    """The ``[safety]`` table."""

    lease_s: Positive = 1.0
    """Time after which a lease that is not renewed is lost; the arm then vents."""
    valve_deadline_s: Positive = 0.15
    """Time without an answer after which the valve bank counts as lost."""
    sensor_deadline_s: Positive = 0.15
    """Time without a valid reading after which a sensor is stale."""
    estimator_deadline_s: Positive = 1.0
    """Time without a result after which the estimator has failed."""
    setpoint_lifetime_s: Positive = 0.1
    """Time after which a set-point written to the valves expires unless the loop renews it."""


class PageSettings(StrictTable):
    """The ``[page]`` table: where ``softarm page --config`` serves the operator page."""

    host: str = "127.0.0.1"
    """Address to serve it on."""
    port: int = Field(default=8080, ge=1, le=65535)
    """Its TCP port; each arm of a host needs its own."""


class SensorSettings(StrictTable):
    """One of ``[[sensors]]``: which reading of which device is which measurement."""

    kind: Literal["pose", "orientation", "bend", "gauge"]
    """``pose`` of a body, ``orientation`` of a body or an inertial unit, ``bend``, force ``gauge``."""
    section: Name
    """Rigid section on which the sensor sits."""
    device: str
    """Name of the device."""
    channel: str = ""
    """Body, unit or place in the chain, where the device has several."""
    needed: bool = False
    """Whether modes that follow the pose cannot do without it."""
    deadline_s: Positive | None = None
    """Without a valid reading for so long it is stale; by default `safety.sensor_deadline_s`, or three
    periods of a slower device."""


class ServiceConfig(StrictTable):
    """Everything that a service runs on.

    Args:
        arm: Name of the arm on the network; that of the file when left out.
        specimen: Path of a specimen or name of a shipped one.
        state_directory: Where saved poses and the tare are kept; the unit's when left out under systemd.
        recording_directory: Where recordings go; ``recordings`` in the unit's when left out under systemd.
        network: zenoh endpoints.
        page: Where the operator page is served.
        control: Rates and model.
        safety: Deadlines.
        sensors: Which readings the estimator uses.
        base_body: Motion-capture body on the base, as ``device/body``; empty when poses are relative to it.
        devices: One table a device; each kind has its own keys, see ``docs/drivers.md``.
    """

    arm: Name
    specimen: str
    state_directory: Path = Path("state")
    recording_directory: Path = Path("recordings")
    network: NetworkSettings = NetworkSettings()
    page: PageSettings = PageSettings()
    control: ControlSettings = ControlSettings()
    safety: SafetySettings = SafetySettings()
    sensors: tuple[SensorSettings, ...] = Field(min_length=1)
    base_body: str = ""
    devices: tuple[dict[str, Any], ...] = Field(min_length=1)

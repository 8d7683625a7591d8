"""Messages of the streams, with units in their names."""

from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from softarm_client.modes import Mode

Vector = tuple[float, float, float]


def _or_newer(value: object, read: ValidatorFunctionWrapHandler) -> object:
    try:
        return read(value)
    except ValidationError:
        if isinstance(value, str):
            return value
        raise


OrNewer = WrapValidator(_or_newer)
"""Marks a list of words that a newer service may extend: a word that is not in it is read as it stands."""


class Message(BaseModel):
    """What every message is: frozen. Fields that a newer service adds are ignored on reading."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Stamp(Message):
    """When a message was made, and on what."""

    sequence: int = Field(ge=0, description="Counts the messages of this stream since the service started.")
    monotonic_ns: int = Field(description="Monotonic clock of the service's host.")
    unix_ns: int = Field(description="Wall clock of the service's host, for ordering across hosts.")
    source: Annotated[Literal["live", "fake", "replay"], OrNewer] = Field(
        description="Where the readings came from."
    )


class HealthFinding(Message):
    """Something a person should know; it clears itself when it no longer holds."""

    code: str = Field(description="Stable name, such as stale_sensor.")
    where: str = Field(description="Device, stream or process.")
    severity: Annotated[Literal["info", "warning", "fault"], OrNewer]
    message: str = Field(description="What is wrong, in one sentence.")
    hint: str = Field(description="What to do about it.")
    since_unix_ns: int = Field(description="When it was first seen.")


class SectionPose(Message):
    """Frame of a rigid section in the base frame."""

    section: str
    position_m: Vector
    quaternion_wxyz: tuple[float, float, float, float]
    position_std_m: Vector | None = Field(default=None, description="Standard deviation of the position.")
    rotation_std_rad: Vector | None = Field(default=None, description="Standard deviation of the rotation.")


class LeaseState(Message):
    """Who may move the arm."""

    holder: str | None = Field(description="Name of the holder, null when the lease is free.")
    remaining_s: float = Field(ge=0.0)


class State(Message):
    """Stream ``state``: the state of the arm and of the service."""

    type: Literal["softarm.state/1"] = "softarm.state/1"
    stamp: Stamp
    mode: Annotated[Mode, OrNewer]
    fault_cause: str | None = Field(description="First cause of the latched fault; null unless FAULTED.")
    findings: tuple[HealthFinding, ...]
    asked_pa: tuple[float, ...] = Field(description="Gauge pressures asked for, one per chamber.")
    applied_pa: tuple[float, ...] = Field(description="Gauge pressures after limits and slew.")
    measured_pa: tuple[float | None, ...] = Field(description="Gauge pressures measured; null when lost.")
    gauges_n: dict[str, float | None] = Field(
        description="Pull on each force gauge by its section; null when lost."
    )
    sections: tuple[SectionPose, ...] = Field(description="Section poses of the last estimate.")
    ages_s: dict[str, float | None] = Field(description="Age of the last valid reading of every input.")
    lease: LeaseState
    ticks: int = Field(ge=0, description="Control ticks since the start.")
    overruns: int = Field(ge=0, description="Ticks skipped because one came late.")
    drift_median_s: float | None = Field(
        default=None, description="How late the ticks of the last five seconds came, median."
    )
    drift_p99_s: float | None = Field(default=None, description="The same, 99th percentile.")
    recording: str | None = Field(description="File being recorded, null when none.")
    teach_pressures_pa: tuple[float, ...] | None = Field(
        default=None,
        description="Pressures that would hold the present pose; null outside TEACH and HOLDING, and without "
        "an estimate of the last half second.",
    )
    teach_reachable: bool | None = Field(
        default=None, description="Whether those pressures hold the pose within the sensors' noise."
    )
    teach_note: str | None = Field(
        default=None, description="Whether the pose can be reached, and why not, in words."
    )


class LoadEstimate(Message):
    """One external force."""

    section: str = Field(description="Rigid section on which it acts.")
    force_n: Vector = Field(
        description="Force in the base frame without inertia of the arm; 0 along an axis not estimated."
    )
    covariance_n2: tuple[tuple[float | None, ...], ...] = Field(
        description="Its covariance, 3 x 3; null along an axis that is not estimated."
    )


class Contact(Message):
    """Where along the arm a single push acts, where the measurements determine it."""

    height_m: float = Field(description="Rest distance from the base along the arm.")
    height_std_m: float = Field(description="Its standard deviation.")
    force_n: tuple[float, float] = Field(description="The push along x and y of the base frame.")
    since_unix_ns: int


class Estimate(Message):
    """Stream ``estimate``: the external force and its uncertainty."""

    type: Literal["softarm.estimate/1"] = "softarm.estimate/1"
    stamp: Stamp
    status: Annotated[Literal["converged", "not_converged", "degraded", "no_data"], OrNewer]
    model: Annotated[Literal["fem", "rod"], OrNewer] = Field(
        description="Model of this estimate: the rod answers while the finite elements have lost the arm."
    )
    loads: tuple[LoadEstimate, ...]
    contact: Contact | None = Field(description="Null where the location cannot be observed.")
    in_contact: bool = Field(description="Whether an external force is distinguishable from noise.")
    tare_n: tuple[Vector, ...] = Field(description="Force taken as zero, one a load.")
    normalised_residual: float | None = Field(
        description="Root mean square of the whitened residual: about 1 when model and measurements agree."
    )
    degrees_of_freedom: int = Field(description="Measurements minus unknowns.")
    unobservable: tuple[str, ...] = Field(description="What these sensors cannot determine, in words.")
    sensors_used: tuple[str, ...]
    sensors_lost: tuple[str, ...]
    latency_s: float = Field(description="From the newest measurement's arrival to this message.")
    solve_s: float = Field(description="Time the estimator took.")


class Mismatch(Message):
    """Stream ``mismatch``: running test of the model against the measurements."""

    type: Literal["softarm.mismatch/1"] = "softarm.mismatch/1"
    stamp: Stamp
    consistent: bool
    since_unix_ns: int | None = Field(description="Since when the two differ; null while consistent.")
    where: tuple[str, ...] = Field(description="Sensors whose innovations stand out.")
    normalised_innovation_squared: float | None = Field(description="Running mean per degree of freedom.")
    recording: str | None = Field(description="Recording that shows the mismatch.")
    advice: str = Field(description="What to do next.")


class Event(Message):
    """Stream ``event``: something that happened once; each also goes into the recording."""

    type: Literal["softarm.event/1"] = "softarm.event/1"
    stamp: Stamp
    kind: Annotated[Literal["mode", "contact_begin", "contact_end", "finding", "finding_cleared"], OrNewer]
    where: str = Field(description="The arm, a device, stream or process.")
    text: str = Field(description="What happened, in words.")
    by: str = Field(default="service", description="Client that asked for it, or service where nobody did.")


class Surface(Message):
    """Query ``surface``: the arm's outer surface at rest, for drawing the stream ``shape``."""

    type: Literal["softarm.surface/1"] = "softarm.surface/1"
    triangles: tuple[tuple[int, int, int], ...] = Field(
        description="Corners of each triangle, counter-clockwise from outside, as indices of nodes."
    )
    rest_m: tuple[Vector, ...] = Field(description="Positions of the nodes of the unloaded arm.")


STREAMS: dict[str, type[Message]] = {
    "state": State,
    "estimate": Estimate,
    "mismatch": Mismatch,
    "event": Event,
}

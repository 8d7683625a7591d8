"""Requests and replies of the commands."""

import re
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, ValidationError
from pydantic_core import from_json

from softarm_client.messages import Message, OrNewer

ErrorCode = Literal[
    "malformed",
    "stale",
    "unauthorised",
    "no_lease",
    "lease_held",
    "out_of_limit",
    "wrong_mode",
    "not_available",
    "busy",
    "internal",
]

CLIENT_NAME = r"^[\w .@-]{1,40}$"
"""Names of clients appear in logs and on the operator page, so they hold no markup."""
FILE_NAME = r"^[A-Za-z0-9_.-]+$"
"""Names of poses and recordings are names of files on the service's host."""
LONGEST_NAME = 60


class Request(Message):
    """What every request carries."""

    # A misspelt field of a request would go unnoticed: the service refuses what it does not know.
    model_config = ConfigDict(extra="forbid")

    deadline_unix_ns: int = Field(
        description="Wall-clock time after which the service refuses the command; at most 60 s ahead."
    )
    sequence: int = Field(
        ge=0,
        description="Rises with every command of a lease that needs the lease; a repeated one is refused.",
    )
    client: str = Field(
        pattern=CLIENT_NAME,
        description="Name of the caller, shown to people: 1 to 40 letters, digits, spaces and any of `_.@-`.",
    )
    sent_unix_ns: int | None = Field(
        default=None,
        description="When the client sent it; a refusal can then name the difference of the two clocks.",
    )
    lease: str | None = Field(default=None, description="Token of the lease, when the client holds it.")


class MovingRequest(Request):
    """A request that moves the arm and so needs the lease."""

    lease: str = Field(description="Token of the lease.")


class GuardedRequest(Request):
    """A request that needs the lease while somebody holds it, and is open to all clients otherwise."""


class SetPressures(MovingRequest):
    """``set_pressures``: gauge pressures for the chambers, for a stated time."""

    pressures_pa: tuple[float, ...]
    lifetime_s: float = Field(
        gt=0.0, le=10.0, description="The arm vents when no new set-point came by then."
    )


class Clear(GuardedRequest):
    """``clear``: leave FAULTED once the cause is gone; the arm stays vented."""


class TeachHold(MovingRequest):
    """``teach/hold``: ramp without a bump to the pressures that hold the pose, then hold with feedback."""

    ramp_s: float = Field(default=2.0, gt=0.0, le=60.0)


class TeachSave(GuardedRequest):
    """``teach/save``: remember the present pose and its pressures under a name."""

    name: str = Field(min_length=1, max_length=LONGEST_NAME, pattern=FILE_NAME)


class TeachGoto(MovingRequest):
    """``teach/goto``: ramp to a saved pose and hold it."""

    name: str
    ramp_s: float = Field(default=2.0, gt=0.0, le=60.0)


class RecordStart(Request):
    """``record/start``: write every stream to a file."""

    name: str = Field(default="recording", min_length=1, max_length=LONGEST_NAME, pattern=FILE_NAME)


class DeviceReconnect(GuardedRequest):
    """``device/reconnect``: close a device and connect it again, also where its driver has given up."""

    device: str = Field(min_length=1, max_length=60, description="Its name in the configuration.")


class LeaseAcquire(Request):
    """``lease/acquire``: get the lease, or renew it with its token."""

    lease: str | None = Field(
        default=None, description="Token of the lease to renew; a new one when left out."
    )


VERBS: dict[str, type[Request]] = {
    "arm": MovingRequest,
    "disarm": MovingRequest,
    "stop": Request,
    "clear": Clear,
    "set_pressures": SetPressures,
    "teach/start": MovingRequest,
    "teach/hold": TeachHold,
    "teach/save": TeachSave,
    "teach/list": Request,
    "teach/goto": TeachGoto,
    "teach/release": MovingRequest,
    "estimate/tare": GuardedRequest,
    "experiment/begin": MovingRequest,
    "experiment/end": MovingRequest,
    "calibrate/rest": GuardedRequest,
    "record/start": RecordStart,
    "record/stop": Request,
    "device/reconnect": DeviceReconnect,
    "lease/acquire": LeaseAcquire,
    "lease/release": MovingRequest,
}
"""Every verb and the request it takes."""

NOT_AFTER_STOP = frozenset(
    verb for verb, request in VERBS.items() if verb == "clear" or issubclass(request, MovingRequest)
)
"""Commands that are refused when a stop arrived after them and before they were carried out."""


class Applied(Message):
    """The one answer to an accepted command: what was applied."""

    verb: str
    mode: str
    applied: dict[str, object] = Field(description="What was applied, named with its unit.")


class Refused(Message):
    """The one answer to a refused command."""

    verb: str
    code: Annotated[ErrorCode, OrNewer]
    message: str
    hint: str


def sender(payload: bytes) -> str:
    """Read who sent a request that may be anything at all; ``somebody`` where it does not say so plainly."""
    try:
        request = from_json(payload)
    except ValueError:
        return "somebody"
    name = request.get("client") if isinstance(request, dict) else None
    return name if isinstance(name, str) and re.fullmatch(CLIENT_NAME, name) else "somebody"


def malformed(verb: str, error: ValidationError) -> Refused:
    """Refuse a request with all its errors, or for want of a lease where nothing else is missing."""
    errors = {".".join(map(str, one["loc"])) or "payload": one for one in error.errors()}
    if "lease" in errors and errors["lease"]["type"] == "missing" and len(errors) == 1:
        hint = "acquire it with lease/acquire first"
        return Refused(verb=verb, code="no_lease", message="the request names no lease", hint=hint)
    message = "; ".join(f"{place}: {one['msg']}" for place, one in errors.items())
    return Refused(verb=verb, code="malformed", message=message, hint="see docs/api.md")

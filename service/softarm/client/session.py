"""zenoh sessions with safe defaults: named endpoints only, no scouting, no shared memory."""

import json
from pathlib import Path
from typing import Literal

import zenoh
from pydantic import BaseModel, ConfigDict, Field

from softarm.estimator.errors import InputError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
LEASE_MS = 1000
"""How soon a silent peer counts as lost; zenoh's own default of 10 s is too long beside an arm."""


class NetworkSettings(BaseModel):
    """The ``[network]`` table of a configuration.

    Args:
        mode: ``peer`` and ``router`` listen; ``client`` connects to a router that serves several arms.
        listen: Endpoints to listen on; zenoh's default would be every interface.
        connect: Endpoints to connect to.
        zenoh_config: JSON5 file with further zenoh settings: TLS, users, access control.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mode: Literal["peer", "router", "client"] = "peer"
    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    connect: tuple[str, ...] = ()
    zenoh_config: Path | None = None
    lease_ms: int = Field(default=LEASE_MS, ge=200, le=60000)


def client_settings(endpoint: str = DEFAULT_ENDPOINT, zenoh_config: Path | None = None) -> NetworkSettings:
    """Settings of a tool that connects to a service."""
    return NetworkSettings(mode="client", listen=(), connect=(endpoint,), zenoh_config=zenoh_config)


def open_session(settings: NetworkSettings) -> zenoh.Session:
    """Open a zenoh session.

    Args:
        settings: Mode, endpoints and an optional file with further settings.

    Returns:
        The session; whoever opens it closes it, or the process hangs at its exit.

    Raises:
        InputError: An endpoint cannot be listened on or reached, or the file is not valid.
    """
    where = str(settings.zenoh_config or "network")
    try:
        config = (
            zenoh.Config.from_file(str(settings.zenoh_config)) if settings.zenoh_config else zenoh.Config()
        )
        for key, value in _overrides(settings).items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        ends = ", ".join((*settings.listen, *settings.connect))
        reason = str(error).split(" at ", maxsplit=1)[0]
        if settings.mode == "client" and "nable to connect" in reason:
            what = f"no zenoh session on {ends}: nothing answers there, or not to these credentials"
            raise InputError(where, what, "start softarm serve there, or name its endpoint") from error
        raise InputError(
            where, f"no zenoh session on {ends} ({reason})", "check that the address is free and reachable"
        ) from error


def _overrides(settings: NetworkSettings) -> dict[str, object]:
    listening = settings.mode != "client"
    overrides: dict[str, object] = {
        "mode": settings.mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": settings.lease_ms,
        "open/return_conditions/connect_scouted": bool(settings.connect),
        "timestamping/enabled": True,
        "adminspace/enabled": listening,
    }
    if listening:
        overrides["listen/endpoints"] = list(settings.listen)
    if settings.connect:
        overrides["connect/endpoints"] = list(settings.connect)
        overrides["connect/timeout_ms"] = 3000
    return overrides


def listening_endpoint(session: zenoh.Session) -> str:
    """Give the first endpoint a session really listens on, with the port that 0 became."""
    for reply in session.get(f"@/{session.zid()}/*", timeout=2.0):
        if reply.ok is not None:
            locators = json.loads(reply.ok.payload.to_string()).get("locators", [])
            if locators:
                return str(locators[0])
    raise InputError("network", "the session listens on no endpoint", "give network.listen an address")

"""zenoh sessions with safe defaults: named endpoints only, no scouting, no shared memory."""

import ipaddress
import json
import os
import re
from pathlib import Path
from typing import Literal, cast

import zenoh
from pydantic import BaseModel, ConfigDict, Field

from softarm_client.errors import SetupError, UnreachableError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
LEASE_MS = 1000
"""How soon a silent peer counts as lost; zenoh's own default of 10 s is too long beside an arm."""
CONNECT_MS = 3000
"""How long an endpoint is tried [ms]."""

TLS = "transport/link/tls"
FILE_KEYS = (
    "transport/auth/usrpwd/dictionary_file",
    f"{TLS}/root_ca_certificate",
    f"{TLS}/listen_certificate",
    f"{TLS}/listen_private_key",
    f"{TLS}/connect_certificate",
    f"{TLS}/connect_private_key",
)
"""Where zenoh's configuration names files."""


OS_ERROR = "(os error "
"""How zenoh writes that the system refused an address: taken, or not on this host (yet)."""


class NetworkSettings(BaseModel):
    """The ``[network]`` table of a configuration.

    Args:
        mode: ``peer`` and ``router`` listen; ``client`` connects to a router that serves several arms.
        listen: Endpoints to listen on; zenoh's default would be every interface.
        connect: Endpoints to connect to.
        zenoh_config: JSON5 file with further zenoh settings: TLS, users, access control.
        lease_ms: How soon a silent peer counts as lost [ms].
        allow_unauthenticated: Whether anybody who reaches an address beyond this host may connect.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mode: Literal["peer", "router", "client"] = "peer"
    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    connect: tuple[str, ...] = ()
    zenoh_config: Path | None = None
    lease_ms: int = Field(default=LEASE_MS, ge=200, le=60000)
    allow_unauthenticated: bool = False

    def relative_to(self, folder: Path) -> "NetworkSettings":
        """Return a copy whose relative path of ``zenoh_config`` starts at a folder."""
        path = None if self.zenoh_config is None else folder / self.zenoh_config
        return self.model_copy(update={"zenoh_config": path})


def client_settings(endpoint: str = DEFAULT_ENDPOINT, zenoh_config: Path | None = None) -> NetworkSettings:
    """Settings of a tool that connects to a service."""
    return NetworkSettings(mode="client", listen=(), connect=(endpoint,), zenoh_config=zenoh_config)


def open_session(settings: NetworkSettings) -> zenoh.Session:
    """Open a zenoh session.

    Args:
        settings: Mode, endpoints and an optional file with further settings.

    Returns:
        The session; whoever opens it closes it.

    Raises:
        SetupError: An endpoint is not valid or would let anybody in, or the file is not valid.
        UnreachableError: An endpoint is taken, or nothing answers at it.
    """
    where = str(settings.zenoh_config or "network")
    for endpoint in unauthenticated_endpoints(settings):
        what = f"{endpoint} gives everybody on the network access"
        cure = "add users or client certificates (deploy/zenoh), or allow it by allow_unauthenticated"
        raise SetupError(where, what, cure)
    config = read_zenoh_config(settings.zenoh_config)
    try:
        for key, value in _overrides(settings).items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        ends = ", ".join((*settings.listen, *settings.connect))
        reason = _reason(error)
        if settings.mode == "client" and "nable to connect" in reason:
            what = f"no zenoh session on {ends}: nothing answers there, or not to these credentials"
            raise UnreachableError(where, what, "start softarm serve there, or name its endpoint") from error
        temporary = OS_ERROR in reason or "nable to connect" in reason
        raise (UnreachableError if temporary else SetupError)(
            where, f"no zenoh session on {ends} ({reason})", "check that the address is free and reachable"
        ) from error


def read_zenoh_config(path: Path | None) -> zenoh.Config:
    """Read a JSON5 file of zenoh; files that it names are looked for beside it.

    Raises:
        SetupError: The file is not there, or not a configuration of zenoh.
    """
    if path is None:
        return zenoh.Config()
    chosen = credential(path)
    try:
        config = zenoh.Config.from_file(str(chosen))
    except zenoh.ZError as error:
        reason = _reason(error)
        raise SetupError(str(path), f"is not a zenoh configuration ({reason})", "see deploy/zenoh") from error
    for key in FILE_KEYS:
        named = _value(config, key)
        if isinstance(named, str):
            config.insert_json5(key, json.dumps(str(credential(path.parent / named))))
    return config


def _reason(error: zenoh.ZError) -> str:
    """Return what zenoh reports, without its place in the source and its own words for an error's type."""
    reason = str(error).split(" at ", maxsplit=1)[0]
    quoted = re.search(r'(?:message|msg): "(.*?)(?:"|$)', reason)
    return quoted[1] if quoted else reason


def credential(path: Path) -> Path:
    """Return the file of the same name that systemd handed over with ``LoadCredential=``, if there is one."""
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    handed = Path(folder) / path.name if folder else path
    return handed if handed.is_file() else path


def unauthenticated_endpoints(settings: NetworkSettings) -> tuple[str, ...]:
    """Return the endpoints beyond this host on which no credentials are asked for.

    Raises:
        SetupError: The file of the settings cannot be read.
    """
    if settings.mode == "client" or settings.allow_unauthenticated:
        return ()
    beyond = tuple(endpoint for endpoint in settings.listen if not _on_this_host(endpoint))
    if not beyond:
        return ()
    config = read_zenoh_config(settings.zenoh_config)
    if _value(config, "transport/auth/usrpwd/dictionary_file"):
        return ()
    certified = _value(config, "transport/link/tls/enable_mtls") is True
    return tuple(end for end in beyond if not (certified and end.startswith(("tls/", "quic/"))))


def _on_this_host(endpoint: str) -> bool:
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unix"):
        return True
    host = address.partition("#")[0].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _value(config: zenoh.Config, key: str) -> object:
    """Return a value of zenoh's configuration, ``None`` where it has none."""
    try:
        return cast("object", json.loads(config.get_json(key)))
    except zenoh.ZError:
        return None


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
        overrides["connect/timeout_ms"] = CONNECT_MS
    return overrides

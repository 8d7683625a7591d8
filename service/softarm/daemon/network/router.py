"""A zenoh router in Python, where ``zenohd`` is missing: ``python -m softarm.daemon.network.router FILE``."""

import json
import signal
import sys
from pathlib import Path

import zenoh

from softarm_client.errors import SetupError
from softarm_client.session import NetworkSettings, open_session, read_zenoh_config

ALLOW = "--allow-unauthenticated"


def open_router(path: Path, *, allow_unauthenticated: bool = False) -> zenoh.Session:
    """Open a router on the endpoints that its configuration names.

    Args:
        path: zenoh configuration of the router.
        allow_unauthenticated: Whether it may listen beyond this host without users or client certificates.

    Raises:
        SetupError: The file cannot be used, or would let anybody on the network in.
    """
    listen = json.loads(read_zenoh_config(path).get_json("listen/endpoints"))
    endpoints = listen if isinstance(listen, list) else listen.get("router", [])
    settings = NetworkSettings(
        mode="router",
        listen=tuple(endpoints),
        zenoh_config=path,
        allow_unauthenticated=allow_unauthenticated,
    )
    return open_session(settings)


def main(arguments: list[str]) -> int:
    """Route until a signal comes.

    Args:
        arguments: Path of the router's configuration, and perhaps ``--allow-unauthenticated``.
    """
    paths = [Path(word) for word in arguments if word != ALLOW]
    if len(paths) != 1:
        print(f"usage: python -m softarm.daemon.network.router FILE [{ALLOW}]", file=sys.stderr)
        return 2
    try:
        with open_router(paths[0], allow_unauthenticated=ALLOW in arguments):
            signal.sigwait((signal.SIGINT, signal.SIGTERM))
    except SetupError as error:
        print(f"softarm router: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    # zenoh's threads inherit the mask: only a blocked signal is certain to reach sigwait.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    sys.exit(main(sys.argv[1:]))

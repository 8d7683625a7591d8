"""A zenoh router in Python, where ``zenohd`` is missing: ``python -m softarm.daemon.network.router FILE``."""

import signal
import sys

import zenoh


def main(path: str) -> None:
    """Route until a signal comes.

    Args:
        path: zenoh configuration of the router.
    """
    with zenoh.open(zenoh.Config.from_file(path)):
        signal.sigwait((signal.SIGINT, signal.SIGTERM))


if __name__ == "__main__":
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    main(sys.argv[1])

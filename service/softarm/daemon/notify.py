"""Messages to systemd: ready, watchdog, stopping."""

import math
import os
import socket
import time
from collections.abc import Callable
from typing import Self

WATCHDOG_EVERY_S = 0.2
"""A tenth of the ``WatchdogSec`` of the unit."""

STARTING_S = 60.0
"""How much more time a service requests while its loop runs and its estimator is being built."""


class Notifier:
    """Speaks to the socket that systemd names in ``NOTIFY_SOCKET``; silent when there is none.

    The socket never blocks: a supervisor that does not read must not stop the arm's loop.

    Args:
        address: The socket's path, abstract when it begins with ``@``; ``None`` for no supervisor.
        clock: Monotonic time [s].
    """

    def __init__(self, address: str | None, clock: Callable[[], float] = time.monotonic) -> None:
        if address is not None and address.startswith("@"):
            # systemd writes the leading zero byte of an abstract address as @.
            address = f"\0{address[1:]}"
        self._address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._clock = clock
        self._unsent = ""
        self._fed_s = -math.inf

    @classmethod
    def from_environment(cls) -> Self:
        """Read the address that systemd passed to the process."""
        return cls(os.environ.get("NOTIFY_SOCKET"))

    def _send(self, text: str) -> bool:
        """Send a message; one to a socket that is full or gone is lost."""
        try:
            if self._address is not None:
                self._socket.sendto(text.encode(), self._address)
        except OSError:
            return False  # a missed watchdog message is no harm: nine more come before systemd acts
        return True

    def ready(self, status: str) -> None:
        """Report that the service is up; a report that the supervisor does not accept is sent again later."""
        report = f"READY=1\nSTATUS={status}"
        self._unsent = "" if self._send(report) else report

    def watchdog(self, starting: bool = False) -> None:
        """Report that the control loop is healthy; only a healthy tick may call this.

        Args:
            starting: Whether to request more time to start, as ``extend`` does.
        """
        now_s = self._clock()
        if now_s - self._fed_s < WATCHDOG_EVERY_S:
            return
        self._fed_s = now_s
        if self._unsent and self._send(self._unsent):
            self._unsent = ""
        self._send("WATCHDOG=1")
        if starting:
            self.extend(STARTING_S)

    def extend(self, seconds: float) -> None:
        """Request more time to start, from now on; systemd would end a start that takes too long."""
        self._send(f"EXTEND_TIMEOUT_USEC={round(seconds * 1e6)}")

    def stopping(self) -> None:
        """Report that the service is going down."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

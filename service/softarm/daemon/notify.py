"""Messages to systemd: ready, watchdog, stopping."""

import os
import socket
from typing import Self


class Notifier:
    """Speaks to the socket that systemd names in ``NOTIFY_SOCKET``; silent when there is none.

    The socket never blocks: a supervisor that does not read must not stop the arm's loop.

    Args:
        address: The socket's path, abstract when it begins with ``@``; ``None`` for no supervisor.
    """

    def __init__(self, address: str | None) -> None:
        if address is not None and address.startswith("@"):
            address = f"\0{address[1:]}"
        self._address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)

    @classmethod
    def from_environment(cls) -> Self:
        """Take the address that systemd gave to the process."""
        return cls(os.environ.get("NOTIFY_SOCKET"))

    def _send(self, text: str) -> None:
        if self._address is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:
            # A full or vanished supervisor socket is the supervisor's trouble: its watchdog will tell.
            return

    def ready(self, status: str) -> None:
        """Say that the service is up."""
        self._send(f"READY=1\nSTATUS={status}")

    def status(self, status: str) -> None:
        """Say in one line what the service does."""
        self._send(f"STATUS={status}")

    def watchdog(self) -> None:
        """Say that the control loop is healthy; only a healthy tick may call this."""
        self._send("WATCHDOG=1")

    def extend(self, seconds: float) -> None:
        """Ask for more time to start, from now on; systemd would end a start that takes too long."""
        self._send(f"EXTEND_TIMEOUT_USEC={round(seconds * 1e6)}")

    def stopping(self) -> None:
        """Say that the service is going down."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

"""The lease: who may move the arm."""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from softarm_client.connection import Connection
from softarm_client.errors import CommandRefusedError

logger = logging.getLogger(__name__)
RETRY_S = 0.05
"""Pause before a renewal of the lease that failed is tried again."""


@dataclass
class HeldLease:
    """A lease that a thread renews.

    Args:
        ends_s: Monotonic time at which it expires unless renewed [s].
        troubled: Whether the last renewal failed.
        reason: Why it was lost; empty while it is held.
        lost: Set when it is lost.
    """

    token: str
    ends_s: float
    troubled: bool = False
    reason: str = ""
    lost: threading.Event = field(default_factory=threading.Event)


class LeasedConnection(Connection):
    """A connection that can hold the lease, once or renewed within a block."""

    def acquire(self) -> None:
        """Get the lease, or renew it."""
        self._acquired()

    def _acquired(self) -> tuple[str, float]:
        """Get the lease, or renew it; return its token and how long it lives [s]."""
        applied = self.command("lease/acquire").applied
        token, remaining_s = str(applied["lease"]), float(str(applied["remaining_s"]))
        self._lease, self._lease_lost = token, ""
        return token, remaining_s

    def release(self) -> None:
        """Return the lease back."""
        self.command("lease/release")
        self._lease = None

    @contextmanager
    def lease(
        self, renew_s: float = 0.3, on_lost: Callable[[str], None] | None = None
    ) -> Iterator["HeldLease"]:
        """Hold the lease within a block, renewed by a thread; leaving the block gives it back.

        A renewal that is refused or not answered is tried again for as long as the lease lives. When it is
        lost the arm vents; every later command of the block that needs the lease is refused with the reason.

        Args:
            renew_s: Time between two renewals.
            on_lost: Called with the reason when the lease is lost, in the thread that renews it.

        Yields:
            The lease: whether it is lost, and why.
        """
        token, remaining_s = self._acquired()
        held = HeldLease(token, time.monotonic() + remaining_s)
        stop = threading.Event()

        def renew() -> None:
            pause_s = renew_s
            while not stop.wait(pause_s):
                reason = self._renew(held)
                pause_s = min(renew_s, RETRY_S) if held.troubled else renew_s
                if reason:
                    self._lose(held, reason, on_lost)
                    return

        thread = threading.Thread(target=renew, name="softarm-lease", daemon=True)
        thread.start()
        try:
            yield held
        finally:
            stop.set()
            thread.join()
            if self._lease is not None:
                try:
                    self.release()
                except CommandRefusedError:
                    self._lease = None

    def _renew(self, held: "HeldLease") -> str:
        """Renew a lease once and return why it is lost, nothing while it lives."""
        try:
            token, remaining_s = self._acquired()
        except CommandRefusedError as error:
            held.troubled = True
            gone = error.refusal.code in ("lease_held", "no_lease")
            return str(error) if gone or time.monotonic() >= held.ends_s else ""
        held.troubled, held.ends_s = False, time.monotonic() + remaining_s
        # A service that had let the lease run out hands out a new one; the arm was vented in between.
        return "" if token == held.token else "it was not renewed in time"

    def _lose(self, held: "HeldLease", reason: str, on_lost: Callable[[str], None] | None) -> None:
        held.reason = self._lease_lost = f"the lease was lost: {reason}"
        if self._lease != held.token and self._lease is not None:
            with suppress(CommandRefusedError):
                self.release()
        self._lease = None
        held.lost.set()
        logger.warning("%s: %s", self.keys.arm, held.reason)
        if on_lost is not None:
            on_lost(held.reason)

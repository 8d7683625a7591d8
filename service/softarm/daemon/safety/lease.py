"""The one lease that a client needs to move the arm."""

import secrets
from dataclasses import dataclass
from typing import Literal

NANOSECONDS = 1_000_000_000


class LeaseError(Exception):
    """A lease that is missing, held by somebody else, or has run out.

    Args:
        code: Why, for programs.
        message: The reason in words.
        hint: What to do about it.
    """

    def __init__(self, code: Literal["no_lease", "lease_held"], message: str, hint: str) -> None:
        super().__init__(message)
        self.code = code
        self.hint = hint


@dataclass(frozen=True)
class Lease:
    """The right to move the arm.

    Args:
        token: Secret that each moving command carries.
        holder: Who holds it, for people to read.
        expires_ns: Monotonic time at which it ends unless renewed.
    """

    token: str
    holder: str
    expires_ns: int


class LeaseManager:
    """Hands out the lease to one holder at a time.

    Args:
        duration_s: How long a lease lives without a renewal.
    """

    def __init__(self, duration_s: float) -> None:
        self._duration_ns = round(duration_s * NANOSECONDS)
        self._lease: Lease | None = None
        self._last_sequence = -1

    def _current(self, now_ns: int) -> Lease | None:
        """Return the lease unless it has run out: commands come between the ticks that expire it."""
        lease = self._lease
        return lease if lease is not None and now_ns < lease.expires_ns else None

    def holder(self, now_ns: int) -> str | None:
        """Name the holder of a lease that has not run out."""
        current = self._current(now_ns)
        return None if current is None else current.holder

    def remaining_s(self, now_ns: int) -> float:
        """Return how long the lease still lives [s]."""
        current = self._current(now_ns)
        return 0.0 if current is None else (current.expires_ns - now_ns) / NANOSECONDS

    def acquire(self, holder: str, now_ns: int, token: str | None = None) -> Lease:
        """Grant or renew the lease.

        Args:
            holder: The client.
            now_ns: Monotonic time.
            token: The token of a lease to renew.

        Returns:
            The lease, with a new end.

        Raises:
            LeaseError: Somebody else holds it, or the token is not that of the lease.
        """
        current = self._current(now_ns)
        if current is not None and token != current.token:
            cure = "wait until it is released or expires"
            raise LeaseError("lease_held", f"the lease is held by {current.holder}", cure)
        if current is None:
            self._last_sequence = -1  # a new client begins its own count
        secret = secrets.token_hex(16) if current is None else current.token
        self._lease = Lease(secret, holder, now_ns + self._duration_ns)
        return self._lease

    def release(self, token: str, now_ns: int) -> None:
        """Release the lease.

        Raises:
            LeaseError: The token is not that of the lease.
        """
        self.check(token, now_ns)
        self._lease = None

    def check(self, token: str | None, now_ns: int) -> None:
        """Refuse a command without the lease.

        Raises:
            LeaseError: No lease, a foreign one, or one that has run out.
        """
        current = self._current(now_ns)
        if current is None:
            raise LeaseError("no_lease", "nobody holds the lease", "acquire it with lease/acquire first")
        if token != current.token:
            message = f"the lease is held by {current.holder}"
            raise LeaseError("lease_held", message, "acquire the lease first")

    def is_current(self, token: str | None, now_ns: int) -> bool:
        """Return whether a token is that of the lease in force."""
        current = self._current(now_ns)
        return current is not None and token == current.token

    def accept_sequence(self, sequence: int) -> bool:
        """Return whether a command's sequence number is new within this lease, and remember it."""
        if sequence <= self._last_sequence:
            return False
        self._last_sequence = sequence
        return True

    def expire(self, now_ns: int) -> Lease | None:
        """Drop a lease that has run out and return it, once."""
        lease = self._lease
        if lease is None or now_ns < lease.expires_ns:
            return None
        self._lease = None
        return lease

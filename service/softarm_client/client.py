"""A client of the service, for the command line, the operator page and anybody's scripts."""

import json
import logging
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import zenoh
from pydantic import ValidationError
from zenoh.ext import HistoryConfig, declare_advanced_subscriber
from zenoh.handlers import Callback

from softarm_client.commands import CLIENT_NAME, VERBS, Applied, MovingRequest, Refused, malformed
from softarm_client.delivery import Delivery, close_at_exit
from softarm_client.errors import CommandRefusedError, SetupError
from softarm_client.keys import ArmKeys
from softarm_client.messages import STREAMS, Estimate, Message, State
from softarm_client.session import DEFAULT_ENDPOINT, client_settings, open_session

logger = logging.getLogger(__name__)
STALE_S = 0.5
"""A service that was not heard for so long is to be taken as gone."""
RETRY_S = 0.05
"""Pause before a renewal of the lease that failed is tried again."""

StreamMessage = TypeVar("StreamMessage", bound=Message)


class SoftarmClient:
    """Reads the streams of one arm and sends it commands.

    Args:
        arm: The arm's name.
        endpoint: Where its service, or a router before it, listens.
        name: Name of this client in logs and on the operator page; letters, digits, spaces and ``_.@-``.
        zenoh_config: JSON5 file with credentials and certificates.

    Raises:
        SetupError: The name is not plain, or the file is not valid.
        UnreachableError: Nothing answers at the endpoint.
    """

    def __init__(
        self,
        arm: str,
        endpoint: str = DEFAULT_ENDPOINT,
        name: str = "softarm-client",
        zenoh_config: Path | None = None,
    ) -> None:
        if not re.fullmatch(CLIENT_NAME, name):
            cure = "use 1 to 40 letters, digits, spaces and any of _.@-"
            raise SetupError("client name", f"{name!r} is not plain", cure)
        self.keys = ArmKeys(arm)
        self.name = name
        self._session = open_session(client_settings(endpoint, zenoh_config))
        close_at_exit(self)
        self._sequence = 0
        self._lease: str | None = None
        self._lease_lost = ""
        self._lock = threading.Lock()
        self._watching = ExitStack()
        self._on_close: list[Callable[[], None]] = []
        self._watched = False
        self._state_s: float | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the session; a lease still held runs out by itself."""
        for ended in tuple(self._on_close):
            ended()
        self._watching.close()
        self._session.close()

    @contextmanager
    def on_close(self, ended: Callable[[], None]) -> Iterator[None]:
        """Call a function when the client is closed within the block."""
        self._on_close.append(ended)
        try:
            yield
        finally:
            self._on_close.remove(ended)

    @property
    def state_age_s(self) -> float:
        """Time since the service's last ``state`` arrived [s], infinite before the first.

        The first call begins to watch the stream. The service sends twenty states a second: an age above
        ``STALE_S`` means that service, network or this process stand still, and what was shown is outdated.
        """
        with self._lock:
            if not self._watched:
                self._watched = True
                self._watching.enter_context(self.subscribe("state", self._note_state))
        return float("inf") if self._state_s is None else time.monotonic() - self._state_s

    def _note_state(self, _: Message) -> None:
        self._state_s = time.monotonic()

    def alive(self) -> bool:
        """Tell whether a service for the arm is there."""
        replies = self._session.liveliness().get(self.keys.alive, timeout=1.0)
        return any(reply.ok is not None for reply in replies)

    def command(self, verb: str, timeout_s: float = 1.0, **fields: object) -> Applied:
        """Send a command and wait for its answer.

        Args:
            verb: Such as ``set_pressures``; see ``docs/api.md``.
            timeout_s: How long the answer may take; the service refuses the command after that time.
            **fields: Fields of the request.

        Returns:
            What was applied.

        Raises:
            CommandRefusedError: The service refused, or there was no answer in time.
        """
        # Numbered and sent in one go: of two threads' commands the later one must not come first.
        with self._lock:
            self._sequence += 1
            payload = self._request(verb, timeout_s, fields)
            replies = self._session.get(self.keys.command(verb), payload=payload, timeout=timeout_s)
        for reply in replies:
            if reply.ok is not None:
                return Applied.model_validate_json(bytes(reply.ok.payload))
            told = b"" if reply.err is None else bytes(reply.err.payload)
            raise CommandRefusedError(_refusal(told) or self._no_answer(verb))
        raise CommandRefusedError(self._no_answer(verb))

    def _request(self, verb: str, timeout_s: float, fields: dict[str, object]) -> bytes:
        """Write a request; the service would refuse what this does."""
        kind, now_ns = VERBS[verb], time.time_ns()
        given: dict[str, object] = {
            "deadline_unix_ns": now_ns + round(timeout_s * 1e9),
            "sequence": self._sequence,
            "client": self.name,
            "sent_unix_ns": now_ns,
        }
        if verb == "stop":  # nothing here may refuse it either
            return json.dumps(given | fields, default=str).encode()
        if self._lease:
            given["lease"] = self._lease
        elif issubclass(kind, MovingRequest) and "lease" not in fields and self._lease_lost:
            hint = "acquire it again with lease/acquire, then arm"
            refusal = Refused(verb=verb, code="no_lease", message=self._lease_lost, hint=hint)
            raise CommandRefusedError(refusal)
        try:
            return kind.model_validate(given | dict(fields)).model_dump_json().encode()
        except ValidationError as error:
            raise CommandRefusedError(malformed(verb, error)) from error

    def _no_answer(self, verb: str) -> Refused:
        hint = f"check that a service for arm {self.keys.arm!r} runs and that this client may command it"
        return Refused(verb=verb, code="not_available", message="no answer in time", hint=hint)

    def ask(self, name: str) -> str:
        """Ask for ``config``, ``specimen``, ``surface`` or ``schema``."""
        for reply in self._session.get(self.keys.query(name), timeout=2.0):
            if reply.ok is not None:
                return str(reply.ok.payload.to_string())
        raise CommandRefusedError(self._no_answer(name))

    @contextmanager
    def subscribe(self, stream: str, handler: Callable[[Message], None]) -> Iterator[None]:
        """Call ``handler`` with every message of a stream, the last one first.

        Args:
            stream: ``state``, ``estimate``, ``mismatch`` or ``event``.
            handler: Called in a thread of its own; the oldest messages are dropped while it is busy.
        """
        kind = STREAMS[stream]

        with self._delivered(lambda data: handler(kind.model_validate_json(data))) as take:
            subscriber = declare_advanced_subscriber(
                self._session, self.keys.stream(stream), take, history=HistoryConfig()
            )
            try:
                yield
            finally:
                subscriber.undeclare()

    @contextmanager
    def subscribe_shape(self, handler: Callable[[bytes], None]) -> Iterator[None]:
        """Call ``handler`` with every shape: x, y, z [m], stress [Pa] per node of ``surface``, float32."""
        with self._delivered(handler) as take:
            subscriber = self._session.declare_subscriber(self.keys.stream("shape"), take)
            try:
                yield
            finally:
                subscriber.undeclare()

    @contextmanager
    def _delivered(self, handler: Callable[[bytes], None]) -> Iterator["Callback[zenoh.Sample]"]:
        """Give zenoh a callback that only hands over, and call the handler in a daemon thread."""
        delivery = Delivery(handler)
        try:
            yield Callback(lambda sample: delivery.put(bytes(sample.payload)), indirect=False)
        finally:
            delivery.close()

    def wait_for(
        self,
        stream: str,
        kind: type[StreamMessage],
        accept: Callable[[StreamMessage], bool],
        timeout_s: float,
    ) -> StreamMessage:
        """Wait for a message of a stream.

        Args:
            stream: The stream's name.
            kind: Its type of message.
            accept: Tells whether a message is the one waited for.
            timeout_s: How long to wait.

        Returns:
            The first message accepted.

        Raises:
            TimeoutError: None came in time.
        """
        found: list[StreamMessage] = []
        done = threading.Event()

        def on_message(message: Message) -> None:
            if isinstance(message, kind) and not done.is_set() and accept(message):
                found.append(message)
                done.set()

        with self.subscribe(stream, on_message):
            if not done.wait(timeout_s):
                raise TimeoutError(f"{self.keys.stream(stream)}: no such message in {timeout_s:g} s")
        return found[0]

    def state(self, timeout_s: float = 2.0) -> State:
        """Give the newest state."""
        return self.wait_for("state", State, lambda _: True, timeout_s)

    def estimate(self, timeout_s: float = 2.0) -> Estimate:
        """Give the newest estimate."""
        return self.wait_for("estimate", Estimate, lambda _: True, timeout_s)

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
        """Give the lease back."""
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


@dataclass
class HeldLease:
    """A lease that a thread renews.

    Args:
        token: Its token.
        ends_s: Monotonic time at which it runs out unless renewed [s].
        troubled: Whether the last renewal failed.
        reason: Why it was lost; empty while it is held.
        lost: Set when it is lost.
    """

    token: str
    ends_s: float
    troubled: bool = False
    reason: str = ""
    lost: threading.Event = field(default_factory=threading.Event)


def _refusal(payload: bytes) -> Refused | None:
    """Read a refusal; ``None`` where it is zenoh's own."""
    try:
        return Refused.model_validate_json(payload)
    except ValidationError:
        return None

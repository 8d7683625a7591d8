"""A client of the service, for the command line, the operator page and anybody's scripts."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import zenoh
from pydantic import ValidationError
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from softarm.api.commands import VERBS, Applied, Refused, malformed
from softarm.api.keys import ArmKeys
from softarm.api.messages import STREAMS, Estimate, Message, State
from softarm.client.session import DEFAULT_ENDPOINT, client_settings, open_session
from softarm.common.errors import WorkFailedError

StreamMessage = TypeVar("StreamMessage", bound=Message)


class CommandRefusedError(WorkFailedError):
    """The service refused a command, or did not answer.

    Args:
        refusal: Code, message and hint.
    """

    def __init__(self, refusal: Refused) -> None:
        super().__init__(f"{refusal.verb}: {refusal.message}; {refusal.hint}")
        self.refusal = refusal


class SoftarmClient:
    """Reads the streams of one arm and sends it commands.

    Use it as a context manager: a zenoh session left open hangs the process at its exit.

    Args:
        arm: The arm's name.
        endpoint: Where its service, or a router before it, listens.
        name: Who the service should say holds the lease.
        zenoh_config: JSON5 file with credentials and certificates.

    Raises:
        InputError: Nothing answers at the endpoint.
    """

    def __init__(
        self,
        arm: str,
        endpoint: str = DEFAULT_ENDPOINT,
        name: str = "softarm-client",
        zenoh_config: Path | None = None,
    ) -> None:
        self.keys = ArmKeys(arm)
        self.name = name
        self._session = open_session(client_settings(endpoint, zenoh_config))
        self._sequence = 0
        self._lease: str | None = None
        self._lock = threading.Lock()

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
        self._session.close()

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

    def _request(self, verb: str, timeout_s: float, fields: Mapping[str, object]) -> bytes:
        """Write a request; the service would refuse what this does."""
        kind = VERBS[verb]
        given: dict[str, object] = {
            "deadline_unix_ns": time.time_ns() + round(timeout_s * 1e9),
            "sequence": self._sequence,
            "client": self.name,
        }
        if self._lease and "lease" in kind.model_fields:
            given["lease"] = self._lease
        try:
            return kind.model_validate(given | dict(fields)).model_dump_json().encode()
        except ValidationError as error:
            raise CommandRefusedError(malformed(verb, error)) from error

    def _no_answer(self, verb: str) -> Refused:
        hint = f"check that a service for arm {self.keys.arm!r} runs and that this client may command it"
        return Refused(verb=verb, code="not_available", message="no answer in time", hint=hint)

    def ask(self, name: str) -> str:
        """Ask for ``config``, ``specimen`` or ``schema``."""
        for reply in self._session.get(self.keys.query(name), timeout=2.0):
            if reply.ok is not None:
                return str(reply.ok.payload.to_string())
        raise CommandRefusedError(self._no_answer(name))

    @contextmanager
    def subscribe(self, stream: str, handler: Callable[[Message], None]) -> Iterator[None]:
        """Call ``handler`` with every message of a stream, the last one first.

        Args:
            stream: ``state``, ``estimate``, ``mismatch`` or ``event``.
            handler: Called in a thread of zenoh's; it must return soon.
        """
        kind = STREAMS[stream]

        def on_sample(sample: zenoh.Sample) -> None:
            handler(kind.model_validate_json(bytes(sample.payload)))

        subscriber = declare_advanced_subscriber(
            self._session, self.keys.stream(stream), on_sample, history=HistoryConfig()
        )
        try:
            yield
        finally:
            subscriber.undeclare()

    @contextmanager
    def subscribe_shape(self, handler: Callable[[bytes], None]) -> Iterator[None]:
        """Call ``handler`` with every shape: x, y, z [m] and stress [Pa] of each node, float32."""
        subscriber = self._session.declare_subscriber(
            self.keys.stream("shape"), lambda sample: handler(bytes(sample.payload))
        )
        try:
            yield
        finally:
            subscriber.undeclare()

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
        applied = self.command("lease/acquire")
        self._lease = str(applied.applied["lease"])

    def release(self) -> None:
        """Give the lease back."""
        self.command("lease/release")
        self._lease = None

    @contextmanager
    def lease(self, renew_s: float = 0.3) -> Iterator[None]:
        """Hold the lease within a block, renewed by a thread; leaving the block gives it back.

        Args:
            renew_s: Time between two renewals.
        """
        self.acquire()
        stop = threading.Event()

        def renew() -> None:
            while not stop.wait(renew_s):
                try:
                    self.acquire()
                except CommandRefusedError:
                    self._lease = None
                    return

        thread = threading.Thread(target=renew, name="softarm-lease", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
            if self._lease is not None:
                try:
                    self.release()
                except CommandRefusedError:
                    self._lease = None


def _refusal(payload: bytes) -> Refused | None:
    """Read a refusal; ``None`` where it is zenoh's own."""
    try:
        return Refused.model_validate_json(payload)
    except ValidationError:
        return None

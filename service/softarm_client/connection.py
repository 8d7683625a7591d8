"""A connection to the service of one arm: commands, queries and streams, as they cross the network."""

import json
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Self

import zenoh
from pydantic import ValidationError
from zenoh.ext import HistoryConfig, declare_advanced_subscriber
from zenoh.handlers import Callback

from softarm_client.commands import CLIENT_NAME, VERBS, Applied, MovingRequest, Refused, malformed
from softarm_client.delivery import Delivery, close_at_exit
from softarm_client.errors import CommandRefusedError, SetupError
from softarm_client.keys import ArmKeys
from softarm_client.session import DEFAULT_ENDPOINT, client_settings, open_session


class Connection:
    """Sends commands to the service of one arm and receives its streams.

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
        *,
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the session; a lease that is still held expires."""
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

    def alive(self) -> bool:
        """Return whether a service for the arm is there."""
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
        return Applied.model_validate_json(self._answer(verb, replies))

    def _request(self, verb: str, timeout_s: float, fields: dict[str, object]) -> bytes:
        """Write a request; the service would refuse what this does."""
        kind, now_ns = VERBS[verb], time.time_ns()
        common: dict[str, object] = {
            "deadline_unix_ns": now_ns + round(timeout_s * 1e9),
            "sequence": self._sequence,
            "client": self.name,
            "sent_unix_ns": now_ns,
        }
        if verb == "stop":  # nothing here may refuse it either
            return json.dumps(common | fields, default=str).encode()
        if self._lease:
            common["lease"] = self._lease
        elif issubclass(kind, MovingRequest) and "lease" not in fields and self._lease_lost:
            hint = "acquire it again with lease/acquire, then arm"
            refusal = Refused(verb=verb, code="no_lease", message=self._lease_lost, hint=hint)
            raise CommandRefusedError(refusal)
        try:
            return kind.model_validate(common | dict(fields)).model_dump_json().encode()
        except ValidationError as error:
            raise CommandRefusedError(malformed(verb, error)) from error

    def _answer(self, name: str, replies: Iterable[zenoh.Reply]) -> bytes:
        """Return the payload of the first reply.

        Raises:
            CommandRefusedError: It is a refusal, or there is none.
        """
        for reply in replies:
            if reply.ok is not None:
                return bytes(reply.ok.payload)
            refusal = None if reply.err is None else _refusal(bytes(reply.err.payload))
            raise CommandRefusedError(refusal or self._no_answer(name))
        raise CommandRefusedError(self._no_answer(name))

    def _no_answer(self, verb: str) -> Refused:
        hint = f"check that a service for arm {self.keys.arm!r} runs and that this client may command it"
        return Refused(verb=verb, code="not_available", message="no answer in time", hint=hint)

    def ask(self, name: str) -> str:
        """Ask for ``config``, ``specimen``, ``surface`` or ``schema``.

        Raises:
            CommandRefusedError: No service answers, or the estimator has not been built yet.
        """
        return self._answer(name, self._session.get(self.keys.query(name), timeout=2.0)).decode()

    @contextmanager
    def receive(self, stream: str, handler: Callable[[bytes], None]) -> Iterator[None]:
        """Call ``handler`` with the payload of every message of a stream, the last one first.

        Args:
            stream: ``state``, ``estimate``, ``mismatch`` or ``event``.
            handler: Called in a thread of its own; the oldest messages are dropped while it is busy.
        """
        with self._delivered(handler) as take:
            key, history = self.keys.stream(stream), HistoryConfig()
            subscriber = declare_advanced_subscriber(self._session, key, take, history=history)
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
        """Return a callback for zenoh that only hands over; the handler runs in a daemon thread."""
        delivery = Delivery(handler)
        try:
            yield Callback(lambda sample: delivery.put(bytes(sample.payload)), indirect=False)
        finally:
            delivery.close()


def _refusal(payload: bytes) -> Refused | None:
    """Read a refusal; ``None`` where it is zenoh's own."""
    try:
        return Refused.model_validate_json(payload)
    except ValidationError:
        return None

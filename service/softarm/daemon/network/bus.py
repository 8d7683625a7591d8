"""The service's side of the keys: streams out, slow values and commands in."""

import asyncio
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from softarm.daemon.network.inbox import Inbox
from softarm_client.commands import Applied, ErrorCode, Refused
from softarm_client.errors import UnreachableError
from softarm_client.keys import ArmKeys
from softarm_client.messages import STREAMS, Message
from softarm_client.session import NetworkSettings, open_session

COMMANDS_WAITING = 16
"""The loop serves them at every pass: with more than these waiting, a client sends without listening."""
STOPS_WAITING = 64
"""A flood of stops is answered without the loop, which has the first of them to carry out."""
LARGEST_REQUEST_BYTES = 16_384
"""A larger request is refused before anybody parses it: parsing 1 MB holds up the control loop for 0.2 s."""
SHAPE = "shape"
STOP_SUFFIX = "/command/stop"


@dataclass(frozen=True)
class Call:
    """A command that arrived and waits for its one answer.

    Args:
        verb: Such as ``teach/start``.
        payload: The request, not yet checked.
        query: zenoh's side of it.
        key: Key of the answer; that of the query may name several arms at once.
        stops_before: How many ``stop`` had arrived before this command.
    """

    verb: str
    payload: bytes
    query: zenoh.Query
    key: str
    stops_before: int

    def answer(self, message: Applied | Refused) -> None:
        """Send the answer and let go of the query, so that the caller need not wait for its timeout."""
        data = message.model_dump_json().encode()
        encoding = zenoh.Encoding("application/json")
        with self.query:
            if isinstance(message, Applied):
                self.query.reply(self.key, data, encoding=encoding)
            else:
                self.query.reply_err(data, encoding=encoding)

    def refuse(self, code: ErrorCode, message: str, hint: str) -> None:
        """Answer with a refusal."""
        self.answer(Refused(verb=self.verb, code=code, message=message, hint=hint))


class Bus:
    """A zenoh session that serves one arm."""

    def __init__(self, settings: NetworkSettings, arm: str, loop: asyncio.AbstractEventLoop) -> None:
        self.keys = ArmKeys(arm)
        self._settings = settings
        self._inbox: Inbox[Call] = Inbox(loop, COMMANDS_WAITING)
        self._loop = loop
        self._on_stop: Callable[[Call], None] | None = None
        self._stops_lock = threading.Lock()
        self.stops_seen = self._stops_waiting = 0
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.ext.AdvancedPublisher] = {}
        self._shape: zenoh.Publisher | None = None
        self._documents: dict[str, bytes | None] = {}
        self._declared: list[object] = []  # zenoh undeclares what nobody holds

    @property
    def session(self) -> zenoh.Session:
        """The open session."""
        assert self._session is not None, "the bus is not open"
        return self._session

    def open(self, documents: Mapping[str, bytes | None], on_stop: Callable[[Call], None]) -> None:
        """Open the session, refuse a second service for the same arm, and declare every key.

        Args:
            documents: JSON documents that clients may query, such as ``config``; ``None`` for one that is
                refused until ``provide`` brings it.
            on_stop: Called in the event loop with every ``stop``; it must vent the arm and answer. A stop
                does not wait behind other commands, and its payload need not be a valid request.

        Raises:
            SetupError: An endpoint is not valid.
            UnreachableError: An address is in use, or the arm is already served.
        """
        self._on_stop = on_stop
        self._session = open_session(self._settings)
        try:
            self._refuse_second_service()
            for name in STREAMS:
                self._publishers[name] = declare_advanced_publisher(
                    self._session,
                    self.keys.stream(name),
                    # A client that joins gets the last state at once, not with the next change.
                    cache=CacheConfig(max_samples=1),
                    # A subscriber that does not keep up must not make the control loop wait.
                    congestion_control=zenoh.CongestionControl.DROP,
                    encoding=zenoh.Encoding(f"application/json;softarm.{name}/1"),
                )
            self._shape = self._session.declare_publisher(
                self.keys.stream(SHAPE),
                congestion_control=zenoh.CongestionControl.DROP,
                encoding=zenoh.Encoding("application/octet-stream;float32"),
            )
            self._documents.update(documents)
            for name in documents:
                self._declared.append(
                    self._session.declare_queryable(self.keys.query(name), partial(self._on_query, name))
                )
            self._declared.append(self._session.declare_queryable(self.keys.command("**"), self._on_command))
            # Last: who waits for the arm to be alive may send commands from then on.
            self._declared.append(self._session.liveliness().declare_token(self.keys.alive))
        except BaseException:
            self.close()
            raise

    def _refuse_second_service(self) -> None:
        for reply in self.session.liveliness().get(self.keys.alive, timeout=0.5):
            if reply.ok is not None:
                raise UnreachableError(  # that of a crashed service disappears a moment later
                    "arm",
                    f"{self.keys.arm} is already served by another service",
                    "stop that one first, or give this arm another name",
                )

    def provide(self, name: str, document: bytes) -> None:
        """Set the answer to the queries for one of the documents."""
        self._documents[name] = document

    def _on_query(self, name: str, query: zenoh.Query) -> None:
        """Answer with a document that was written once, at no cost to the control loop."""
        document, encoding = self._documents[name], zenoh.Encoding("application/json")
        with query:
            if document is not None:
                query.reply(self.keys.query(name), document, encoding=encoding)
                return
            hint = "ask again when the mode is no longer STARTING"
            refused = Refused(
                verb=name, code="not_available", message="the estimator has not been built yet", hint=hint
            )
            query.reply_err(refused.model_dump_json().encode(), encoding=encoding)

    def _on_command(self, query: zenoh.Query) -> None:
        # Runs in a thread of zenoh: nothing of the loop may be touched here.
        key_expression = str(query.key_expr)
        if key_expression.endswith(STOP_SUFFIX):  # also softarm/@v1/*/command/stop, which stops every arm
            self._hand_over_stop(query)
            return
        payload = _payload(query)
        verb = key_expression.removeprefix(self.keys.command(""))
        call = Call(verb, payload or b"", query, key_expression, self.stops_seen)
        if payload is None:
            message = f"the request has more than {LARGEST_REQUEST_BYTES} bytes"
            call.refuse("malformed", message, "send the fields of docs/api.md and nothing else")
        elif not self._inbox.offer(call):
            hint = "wait for the answers to the commands before sending more"
            call.refuse("busy", "too many commands are waiting", hint)

    def _hand_over_stop(self, query: zenoh.Query) -> None:
        """Request that the loop stops the arm next, ahead of every waiting command."""
        # The loop counts down what zenoh's threads count up.
        with self._stops_lock:
            self.stops_seen += 1
            waiting = self._stops_waiting
            self._stops_waiting += waiting < STOPS_WAITING
        call = Call("stop", _payload(query) or b"", query, self.keys.command("stop"), self.stops_seen)
        if waiting >= STOPS_WAITING:
            call.refuse("busy", "the arm is being stopped already", "wait for the answer to the first stop")
            return
        try:
            self._loop.call_soon_threadsafe(self._carry_out, call)
        except RuntimeError:  # the loop has ended, and the service vented the arm before that
            call.refuse("not_available", "the service has ended", "check that the chambers are vented")

    def _carry_out(self, call: Call) -> None:
        assert self._on_stop is not None, "the bus is not open"
        with self._stops_lock:
            self._stops_waiting -= 1
        self._on_stop(call)

    def stopped_since(self, call: Call) -> bool:
        """Return whether a ``stop`` arrived after a command that still waits."""
        return call.stops_before < self.stops_seen

    def publish(self, stream: str, message: Message) -> None:
        """Publish on a stream; a slow subscriber loses messages and never stops the service."""
        self._publishers[stream].put(message.model_dump_json().encode())

    @property
    def shape_wanted(self) -> bool:
        """Whether anybody listens to the shape."""
        # The wheel's stub states bool; the value is an object that is always true and carries the answer.
        status: Any = None if self._shape is None else self._shape.matching_status
        return bool(getattr(status, "matching", status))

    def publish_shape(self, nodes: bytes) -> None:
        """Publish the shape: x, y, z [m] and stress [Pa] of every node of ``surface``, as ``<f4``."""
        if self._shape is not None:
            self._shape.put(nodes)

    async def next_call(self) -> Call:
        """Wait for the next command."""
        return await self._inbox.take()

    def close(self) -> None:
        """Answer what still waits and close the session."""
        for call in self._inbox.close():
            hint = "try again when the service is back"
            call.refuse("not_available", "the service is stopping", hint)
        if self._session is not None:
            self._session.close()
            self._session = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _payload(query: zenoh.Query) -> bytes | None:
    """Copy a request out of zenoh's memory; ``None`` when it is too large to be parsed."""
    payload = query.payload
    if payload is None:
        return b""
    return bytes(payload) if len(payload) <= LARGEST_REQUEST_BYTES else None

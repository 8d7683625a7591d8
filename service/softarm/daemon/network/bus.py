"""The service's side of the keys: streams out, slow values and commands in."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from softarm.api.commands import Applied, Refused
from softarm.api.keys import ArmKeys
from softarm.api.messages import STREAMS, Message
from softarm.client.session import NetworkSettings, open_session
from softarm.daemon.network.inbox import Inbox
from softarm.estimator.errors import InputError

COMMANDS_WAITING = 16
SHAPE = "shape"


@dataclass(frozen=True)
class Call:
    """A command that arrived and waits for its one answer.

    Args:
        verb: Such as ``teach/start``.
        payload: The request, not yet checked.
        query: zenoh's side of it.
    """

    verb: str
    payload: bytes
    query: zenoh.Query

    def answer(self, message: Applied | Refused) -> None:
        """Send the answer and let go of the query, so that the caller need not wait for its timeout."""
        data = message.model_dump_json().encode()
        encoding = zenoh.Encoding("application/json")
        with self.query:
            if isinstance(message, Applied):
                self.query.reply(self.query.key_expr, data, encoding=encoding)
            else:
                self.query.reply_err(data, encoding=encoding)


class Bus:
    """A zenoh session that serves one arm.

    Args:
        settings: Where to listen.
        arm: The arm's name.
        loop: The event loop that takes the commands.
    """

    def __init__(self, settings: NetworkSettings, arm: str, loop: asyncio.AbstractEventLoop) -> None:
        self.keys = ArmKeys(arm)
        self._settings = settings
        self._inbox: Inbox[Call] = Inbox(loop, COMMANDS_WAITING)
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.ext.AdvancedPublisher] = {}
        self._shape: zenoh.Publisher | None = None
        self._declared: list[object] = []  # zenoh undeclares what nobody holds

    @property
    def session(self) -> zenoh.Session:
        """The open session."""
        assert self._session is not None, "the bus is not open"
        return self._session

    def open(self, slow_values: Mapping[str, Callable[[], bytes]]) -> None:
        """Open the session, refuse a second service for the same arm, and declare every key.

        Args:
            slow_values: Providers of the values that are asked for: ``config``, ``specimen``, ``schema``.

        Raises:
            InputError: The address is taken, or the arm is already served.
        """
        self._session = open_session(self._settings)
        try:
            self._refuse_second_service()
            for name in STREAMS:
                self._publishers[name] = declare_advanced_publisher(
                    self._session,
                    self.keys.stream(name),
                    cache=CacheConfig(max_samples=1),
                    congestion_control=zenoh.CongestionControl.DROP,
                    encoding=zenoh.Encoding(f"application/json;softarm.{name}/1"),
                )
            self._shape = self._session.declare_publisher(
                self.keys.stream(SHAPE),
                congestion_control=zenoh.CongestionControl.DROP,
                encoding=zenoh.Encoding("application/octet-stream;float32"),
            )
            for name, provider in slow_values.items():
                self._declared.append(
                    self._session.declare_queryable(self.keys.query(name), _provide(provider))
                )
            self._declared.append(self._session.declare_queryable(self.keys.command("**"), self._on_command))
            self._declared.append(self._session.liveliness().declare_token(self.keys.alive))
        except BaseException:
            self.close()
            raise

    def _refuse_second_service(self) -> None:
        for reply in self.session.liveliness().get(self.keys.alive, timeout=0.5):
            if reply.ok is not None:
                raise InputError(
                    "arm",
                    f"{self.keys.arm} is already served by another service",
                    "stop that one first, or give this arm another name",
                )

    def _on_command(self, query: zenoh.Query) -> None:
        verb = str(query.key_expr).removeprefix(self.keys.command(""))
        call = Call(verb, bytes(query.payload) if query.payload is not None else b"", query)
        if not self._inbox.offer(call):
            hint = "wait for the answers to the commands before sending more"
            call.answer(Refused(verb=verb, code="busy", message="too many commands are waiting", hint=hint))

    def publish(self, stream: str, message: Message) -> None:
        """Publish on a stream; a slow subscriber loses messages and never stops the service."""
        self._publishers[stream].put(message.model_dump_json().encode())

    @property
    def shape_wanted(self) -> bool:
        """Whether anybody listens to the shape."""
        # The wheel's stub says bool; what comes is an object that is always true and carries the answer.
        status: Any = None if self._shape is None else self._shape.matching_status
        return bool(getattr(status, "matching", status))

    def publish_shape(self, nodes: bytes) -> None:
        """Publish the shape: x, y, z [m] and stress [Pa] of every node, little-endian float32."""
        if self._shape is not None:
            self._shape.put(nodes)

    async def next_call(self) -> Call:
        """Wait for the next command."""
        return await self._inbox.take()

    def close(self) -> None:
        """Answer what still waits and close the session."""
        for call in self._inbox.close():
            hint = "try again when the service is back"
            call.answer(
                Refused(verb=call.verb, code="not_available", message="the service is stopping", hint=hint)
            )
        if self._session is not None:
            self._session.close()
            self._session = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _provide(provider: Callable[[], bytes]) -> Callable[[zenoh.Query], None]:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, provider(), encoding=zenoh.Encoding("application/json"))

    return answer

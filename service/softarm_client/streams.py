"""A stream of an arm, for a ``for`` loop, an ``async for`` loop or a handler."""

import asyncio
import queue
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Generic, TypeVar

from softarm_client.connection import Connection
from softarm_client.delivery import WAITING, put_latest
from softarm_client.errors import ServiceSilentError
from softarm_client.messages import Message

Kind = TypeVar("Kind", bound=Message)


class Stream(Generic[Kind]):
    """The messages of one stream, the last one published first.

    Each loop has a subscription of its own. It ends when the arm is closed. A loop that is slower than
    the stream loses the oldest messages.

    Args:
        connection: Connection to the arm's service.
        name: Name of the stream.
        kind: Type of its messages.
        silent_s: A loop fails when nothing is published for so long [s]; ``None`` waits for ever.
    """

    def __init__(self, connection: Connection, name: str, kind: type[Kind], silent_s: float | None) -> None:
        self._connection = connection
        self._name = name
        self._kind = kind
        self._silent_s = silent_s

    @contextmanager
    def subscribe(self, handler: Callable[[Kind], None]) -> Iterator[None]:
        """Call a handler with each message within a block, in a thread of its own.

        Args:
            handler: Takes the messages; the oldest are dropped while it is busy.
        """
        read = self._kind.model_validate_json
        with self._connection.receive(self._name, lambda payload: handler(read(payload))):
            yield

    def wait_for(self, accept: Callable[[Kind], bool], timeout_s: float) -> Kind:
        """Wait for a message.

        Args:
            accept: Decides whether a message is the one to wait for.
            timeout_s: How long to wait [s].

        Returns:
            The first message accepted.

        Raises:
            TimeoutError: None came in time.
        """
        matching: list[Kind] = []
        done = threading.Event()

        def check(message: Kind) -> None:
            if not done.is_set() and accept(message):
                matching.append(message)
                done.set()

        with self.subscribe(check):
            if not done.wait(timeout_s):
                key = self._connection.keys.stream(self._name)
                raise TimeoutError(f"{key}: no such message in {timeout_s:g} s")
        return matching[0]

    def newest(self, timeout_s: float = 2.0) -> Kind:
        """Return the newest message.

        Args:
            timeout_s: How long to wait for it [s].

        Raises:
            ServiceSilentError: None came in time.
        """
        try:
            return self.wait_for(lambda _: True, timeout_s)
        except TimeoutError:
            raise self._silent(timeout_s) from None

    def __iter__(self) -> Iterator[Kind]:
        waiting: queue.Queue[Kind | None] = queue.Queue(WAITING)

        put = partial(put_latest, waiting)
        with self._connection.on_close(lambda: put(None)), self.subscribe(put):
            while True:
                try:
                    message = waiting.get(timeout=self._silent_s)
                except queue.Empty:
                    raise self._silent(self._silent_s) from None
                if message is None:
                    return
                yield message

    async def __aiter__(self) -> AsyncIterator[Kind]:
        loop = asyncio.get_running_loop()
        waiting: asyncio.Queue[Kind | None] = asyncio.Queue()

        def put(message: Kind | None) -> None:
            if waiting.qsize() >= WAITING:
                waiting.get_nowait()
            waiting.put_nowait(message)

        def hand_over(message: Kind | None) -> None:
            loop.call_soon_threadsafe(put, message)

        subscription = self.subscribe(hand_over)
        with self._connection.on_close(lambda: hand_over(None)):
            await asyncio.to_thread(subscription.__enter__)
            try:
                while (message := await self._next(waiting)) is not None:
                    yield message
            finally:
                subscription.__exit__(None, None, None)

    async def _next(self, waiting: "asyncio.Queue[Kind | None]") -> Kind | None:
        try:
            return await asyncio.wait_for(waiting.get(), self._silent_s)
        except TimeoutError:
            raise self._silent(self._silent_s) from None

    def _silent(self, seconds: float | None) -> ServiceSilentError:
        key = self._connection.keys.stream(self._name)
        what = f"nothing published for {seconds:g} s"
        return ServiceSilentError(f"{key}: {what}; check that the service runs and that the network works")

"""A stream of an arm, for a ``for`` loop, an ``async for`` loop or a handler."""

import asyncio
import queue
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Generic, TypeVar

from softarm_client.errors import ServiceSilentError
from softarm_client.messages import Message

if TYPE_CHECKING:
    from softarm_client.client import SoftarmClient

Kind = TypeVar("Kind", bound=Message)
WAITING = 64
"""So many messages may wait for a slow loop; the oldest is dropped first."""


class Stream(Generic[Kind]):
    """The messages of one stream, the last one published first.

    Each loop has a subscription of its own. It ends when the client is closed. A loop that is slower than
    the stream loses the oldest messages.

    Args:
        client: Client of the arm.
        name: Name of the stream.
        kind: Type of its messages.
        silent_s: A loop fails when nothing is published for so long [s]; ``None`` waits for ever.
    """

    def __init__(self, client: "SoftarmClient", name: str, kind: type[Kind], silent_s: float | None) -> None:
        self._client = client
        self._name = name
        self._kind = kind
        self._silent_s = silent_s

    def subscribe(self, handler: Callable[[Kind], None]) -> AbstractContextManager[None]:
        """Call a handler with each message within a block, in a thread of its own."""

        def typed(message: Message) -> None:
            if isinstance(message, self._kind):
                handler(message)

        return self._client.subscribe(self._name, typed)

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
        return self._client.wait_for(self._name, self._kind, accept, timeout_s)

    def __iter__(self) -> Iterator[Kind]:
        waiting: queue.Queue[Kind | None] = queue.Queue(WAITING)

        def put(message: Kind | None) -> None:
            while True:
                try:
                    return waiting.put_nowait(message)
                except queue.Full:
                    _drop_oldest(waiting)

        with self._client.on_close(lambda: put(None)), self.subscribe(put):
            while True:
                try:
                    message = waiting.get(timeout=self._silent_s)
                except queue.Empty:
                    raise self._silent() from None
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
        with self._client.on_close(lambda: hand_over(None)):
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
            raise self._silent() from None

    def _silent(self) -> ServiceSilentError:
        key = self._client.keys.stream(self._name)
        what = f"nothing published for {self._silent_s:g} s"
        return ServiceSilentError(f"{key}: {what}; check that the service runs and that the network works")


def _drop_oldest(waiting: "queue.Queue[Kind | None]") -> None:
    try:
        waiting.get_nowait()
    except queue.Empty:  # the loop was faster
        return

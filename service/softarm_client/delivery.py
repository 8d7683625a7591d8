"""Hands messages from zenoh's threads to a handler in a thread that never keeps a process from ending."""

import atexit
import logging
import queue
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, Protocol, TypeVar

logger = logging.getLogger(__name__)
Item = TypeVar("Item")
LAST_HANDLER_S = 2.0
"""A handler that is still at work when its delivery is closed is waited for so long."""
WAITING = 64
"""So many messages may wait for a slow handler or loop; the oldest is dropped first."""


class Closable(Protocol):
    """Something that is closed once."""

    def close(self) -> None:
        """Close it; closing it again does nothing."""


_open: "weakref.WeakSet[Closable]" = weakref.WeakSet()


def close_at_exit(client: Closable) -> None:
    """Close a client when the process ends, if it is still in use then."""
    _open.add(client)


@atexit.register
def _close_all() -> None:
    for client in tuple(_open):
        client.close()


def put_latest(waiting: "queue.Queue[Item]", item: Item) -> None:
    """Add an item; where too many wait the oldest is dropped."""
    while True:
        try:
            return waiting.put_nowait(item)
        except queue.Full:
            _drop_oldest(waiting)


def _drop_oldest(waiting: "queue.Queue[Item]") -> None:
    with suppress(queue.Empty):  # the reader was faster
        waiting.get_nowait()


class Delivery(Generic[Item]):
    """Calls a handler with each item, in a daemon thread of its own, until it is closed.

    zenoh's own threads for Python callbacks are not daemons: a process whose session nobody closed would
    wait for them for ever.

    Args:
        handler: Takes the items, one at a time.
    """

    def __init__(self, handler: Callable[[Item], None]) -> None:
        self._handler = handler
        self._items: queue.Queue[Item | None] = queue.Queue(WAITING)
        self._thread = threading.Thread(target=self._run, name="softarm-delivery", daemon=True)
        self._thread.start()

    def put(self, item: Item | None) -> None:
        """Add an item; where too many wait the oldest is dropped."""
        put_latest(self._items, item)

    def _run(self) -> None:
        while (item := self._items.get()) is not None:
            try:
                self._handler(item)
            except Exception:  # the fault of one message, or of whoever handles it, must not end the stream
                logger.exception("a message could not be handled")

    def close(self) -> None:
        """End the thread after the item that it works on; a handler may close its own delivery."""
        while not self._items.empty():
            _drop_oldest(self._items)
        self.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(LAST_HANDLER_S)

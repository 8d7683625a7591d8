"""A bounded hand-over from zenoh's threads to the event loop."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")


class Inbox(Generic[Item]):
    """Items from other threads, read in the loop; a burst costs one wake-up.

    Args:
        loop: The loop that reads.
        capacity: How many wait at most; what comes on top is refused, never queued.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, capacity: int) -> None:
        self._loop = loop
        self._capacity = capacity
        self._items: deque[Item] = deque()
        self._ready = asyncio.Event()
        self._waking = False
        self._closed = False

    def offer(self, item: Item) -> bool:
        """Add an item from any thread; return false when it was refused."""
        if self._closed or len(self._items) >= self._capacity:
            return False
        self._items.append(item)
        # Two threads may both wake the loop, which costs one idle pass; at least one of them does.
        if not self._waking:
            self._waking = True
            self._loop.call_soon_threadsafe(self._wake)
        return True

    def _wake(self) -> None:
        self._waking = False  # before the items are read: one that comes now wakes the loop again
        self._ready.set()

    async def take(self) -> Item:
        """Wait for the next item."""
        while not self._items:
            self._ready.clear()
            await self._ready.wait()
        return self._items.popleft()

    def close(self) -> tuple[Item, ...]:
        """Refuse everything from now on and return what still waits."""
        self._closed = True
        waiting = tuple(self._items)
        self._items.clear()
        return waiting


async def serve_each(
    take: Callable[[], Awaitable[Item]],
    serve: Callable[[Item], Coroutine[Any, Any, None]],
    tasks: asyncio.TaskGroup,
) -> None:
    """Begin to serve items in the order they come, for ever; none waits for a slow one.

    Args:
        take: Waits for the next item.
        serve: Serves one; the group owns what it waits for.
        tasks: The group.
    """
    while True:
        tasks.create_task(serve(await take()))

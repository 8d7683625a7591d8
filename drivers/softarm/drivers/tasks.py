"""Ending tasks for certain."""

import asyncio

AGAIN_S = 0.2


async def finish(*tasks: "asyncio.Task[None]", cancel: bool = False) -> None:
    """Wait until tasks have ended, whatever they raise; being cancelled meanwhile does not cut it short.

    One cancellation of a task is not enough to end it: `asyncio.wait_for` of Python 3.11 drops it when what
    it waits for is done in the same moment, and libraries built on it then go on as if nobody had
    cancelled.

    Args:
        tasks: What to wait for; each must end by itself, or on being cancelled.
        cancel: Cancel them, and again until they have ended.

    Raises:
        asyncio.CancelledError: The wait was cancelled; the tasks have ended all the same.
    """
    pending = set(tasks)
    interrupted = False
    while pending:
        if cancel:
            for task in pending:
                task.cancel()
        try:
            _, pending = await asyncio.wait(pending, timeout=AGAIN_S if cancel else None)
        except asyncio.CancelledError:
            interrupted = True
            pending = {task for task in pending if not task.done()}
    for task in tasks:
        if not task.cancelled():
            task.exception()
    if interrupted:
        raise asyncio.CancelledError

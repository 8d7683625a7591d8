"""Signals that end a command, awaited where it chooses."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = signal.SIGINT, signal.SIGTERM


@contextmanager
def awaiting_signals() -> Iterator[None]:
    """Keep signals that end the command for ``sigwait``; threads started meanwhile never get them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

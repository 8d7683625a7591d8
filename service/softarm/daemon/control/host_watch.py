"""Checks the host once a second in a separate thread: a disk that hangs must not hang the loop."""

import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from softarm.daemon.control.lateness import read_pressure

CHECK_EVERY_S = 1.0


@dataclass(frozen=True)
class HostLoad:
    """State of the host at the last check.

    Args:
        free_bytes: Space left where recordings go; ``None`` before the first check.
        starved_percent: Share of time in which programs waited for a processor [%]; ``None`` when unknown.
    """

    free_bytes: int | None = None
    starved_percent: float | None = None


class HostWatch:
    """Keeps the newest state of the host; use it as a context manager.

    Args:
        directory: Where recordings go.
        free: Returns the space left on the disk of an existing directory [bytes].
    """

    def __init__(
        self, directory: Path, free: Callable[[Path], int] = lambda path: shutil.disk_usage(path).free
    ) -> None:
        self._directory = directory
        self._free = free
        self._stop = threading.Event()
        self.newest = HostLoad()

    def __enter__(self) -> Self:
        # A daemon, and never joined: it may hang in a call to the disk for ever.
        threading.Thread(target=self._watch, name="softarm-host", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()

    def _watch(self) -> None:
        while True:
            self.check()
            if self._stop.wait(CHECK_EVERY_S):
                return

    def check(self) -> None:
        """Look at the host now; this may wait for the disk."""
        existing = next(p for p in (self._directory, *self._directory.parents) if p.exists())
        try:
            free: int | None = self._free(existing)
        except OSError:
            free = None
        self.newest = HostLoad(free, read_pressure())  # one assignment: the loop reads it without a lock

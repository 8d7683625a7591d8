"""A background thread that works on the latest request while its caller continues."""

from collections.abc import Callable
from threading import Condition, Thread
from typing import Generic, Self, TypeVar

Request = TypeVar("Request")
Answer = TypeVar("Answer")


class Background(Generic[Request, Answer]):
    """Owns one thread that answers requests, the newest one next.

    It gains time only where the work runs without the interpreter's lock. Use it as a context manager.
    """

    def __init__(self, work: Callable[[Request], Answer], name: str) -> None:
        self._work = work
        self._changed = Condition()
        self._request: Request | None = None
        self._answer: Answer | None = None
        self._failure: Exception | None = None
        self._busy = self._closing = False
        # A daemon: a program that ends on an error does not wait for work of seconds.
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Let the thread finish its present request, and end it."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    @property
    def newest(self) -> Answer | None:
        """The newest answer, ``None`` before the first."""
        with self._changed:
            return self._answer

    @property
    def idle(self) -> bool:
        """Whether no request is pending or being worked on."""
        with self._changed:
            return self._request is None and not self._busy

    def ask(self, request: Request) -> None:
        """Request work, in place of an earlier request that has not begun.

        Raises:
            RuntimeError: Earlier work failed unexpectedly; the cause is attached.
        """
        with self._changed:
            # Raised here, in the caller's thread: the worker has nobody to report it to.
            if self._failure is not None:
                raise RuntimeError(f"{self._thread.name} failed") from self._failure
            self._request = request
            self._changed.notify_all()

    def wait(self) -> None:
        """Wait until no request is pending or being worked on."""
        with self._changed:
            self._changed.wait_for(lambda: self._closing or (self._request is None and not self._busy))

    def _run(self) -> None:
        while (request := self._next()) is not None:
            try:
                answer, failure = self._work(request), None
            except Exception as error:  # noqa: BLE001 (the boundary of the thread; handed to the caller)
                answer, failure = None, error
            with self._changed:
                self._answer, self._failure = answer, failure
                # After a failure as well, or `wait` would never return.
                self._busy = False
                self._changed.notify_all()

    def _next(self) -> Request | None:
        """Wait for a request; ``None`` at the end."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._closing or self._failure is not None or self._request is not None
            )
            if self._closing or self._failure is not None:
                return None
            # Taken and marked under one lock, so that `idle` is not true in between.
            request, self._request, self._busy = self._request, None, True
            return request

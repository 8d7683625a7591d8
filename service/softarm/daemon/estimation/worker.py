"""A process that solves one request after another, with a mailbox of one.

Numerics in a thread hold the interpreter's lock for tens of milliseconds; in a process they cannot delay
the control loop. Requests and results are small, so a pipe carries them.
"""

import asyncio
import contextlib
import faulthandler
import gc
import logging
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

logger = logging.getLogger(__name__)
Request = TypeVar("Request")
Result = TypeVar("Result")
Solver = Callable[[Any], Any]
SolverFactory = Callable[[], Solver]

RESTARTS_ALLOWED = 5
KILL_AFTER_S = 2.0
STUCK_S = 5.0
"""A request that takes longer is given up, and the process with it."""
NICER = 5
"""Numerics that fill a core give way to the control loop and the drivers."""


@dataclass(frozen=True)
class WorkerState:
    """What became of the process.

    Args:
        running: Whether it lives and has said that it is ready.
        restarts: How often it was started again.
        gave_up: Whether it died too often to be started again.
    """

    running: bool
    restarts: int
    gave_up: bool

    @property
    def starting(self) -> bool:
        """Whether it is being built for the first time."""
        return not self.running and not self.gave_up and self.restarts == 0


def _serve(pipe: Connection, factory: SolverFactory, nicer: int) -> None:
    """Run in the child: build the solver, then answer until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(PermissionError):  # a sandbox may forbid it
        os.nice(nicer)
    try:
        solver = factory()
        gc.collect()
        gc.freeze()  # a collection of all that the solver is built of takes tens of milliseconds
        pipe.send(None)
        while True:
            request = pipe.recv()
            faulthandler.dump_traceback_later(0.9 * STUCK_S)  # says in the log where it is stuck
            result = solver(request)
            faulthandler.cancel_dump_traceback_later()
            pipe.send(result)
    except (EOFError, BrokenPipeError):
        return


class Worker(Generic[Request, Result]):
    """Owns the process; use it as an asynchronous context manager.

    Args:
        factory: Builds the solver in the child; it must be picklable.
        on_result: Takes each result, in the event loop.
        clock: Monotonic time [s].
        nicer: By how much the process gives way to this one.
    """

    def __init__(
        self,
        factory: SolverFactory,
        on_result: Callable[[Result], None],
        clock: Callable[[], float] = time.monotonic,
        nicer: int = NICER,
    ) -> None:
        self._factory = factory
        self._on_result = on_result
        self._context = multiprocessing.get_context("spawn")
        self._loop = asyncio.get_running_loop()
        self._process: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None
        self._ready = asyncio.Event()
        self._waiting: Request | None = None
        self._busy = True
        self._clock = clock
        self._nicer = nicer
        self._sent_s = clock()
        self._restarts = 0
        self._closing = False
        self._changed = asyncio.Event()
        self.replaced = 0

    @property
    def state(self) -> WorkerState:
        """What became of the process."""
        gave_up = self._process is None and self._restarts > RESTARTS_ALLOWED
        return WorkerState(self._process is not None and self._ready.is_set(), self._restarts, gave_up)

    @property
    def pid(self) -> int | None:
        """Process number, while there is one."""
        return None if self._process is None else self._process.pid

    async def __aenter__(self) -> "Worker[Request, Result]":
        self._start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._closing = True
        process = self._process
        self._detach()
        if process is not None:
            await asyncio.to_thread(_end, process)

    async def until(self, accept: Callable[[WorkerState], bool]) -> None:
        """Wait until the process is in an accepted state."""
        while not accept(self.state):
            self._changed.clear()
            await self._changed.wait()

    def submit(self, request: Request) -> None:
        """Hand over a request; one that still waits is replaced by the newer one."""
        if self._busy or self._pipe is None:
            self._give_up_when_stuck()
            self.replaced += self._waiting is not None
            self._waiting = request
            return
        self._send(request)

    def _give_up_when_stuck(self) -> None:
        """Kill a process that has been at one request for too long; its end starts a new one."""
        stuck = self._ready.is_set() and self._clock() - self._sent_s > STUCK_S
        if stuck and self._process is not None:
            logger.warning("the estimator was at one request for %g s; it is started anew", STUCK_S)
            self._sent_s = self._clock()
            self._process.kill()

    def _send(self, request: Request) -> None:
        assert self._pipe is not None
        self._busy = True
        self._sent_s = self._clock()
        self._waiting = None
        try:
            self._pipe.send(request)
        except (BrokenPipeError, OSError):
            self._busy = True  # the watch on the process tells of its end

    def _start(self) -> None:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=_serve, args=(theirs, self._factory, self._nicer), name="softarm-estimator", daemon=True
        )
        process.start()
        theirs.close()
        self._process, self._pipe, self._busy = process, ours, True
        self._ready.clear()
        self._loop.add_reader(ours.fileno(), self._on_readable)

    def _on_readable(self) -> None:
        assert self._pipe is not None
        try:
            message = self._pipe.recv()
        except (EOFError, OSError):
            self._on_death()
            return
        self._busy = False
        if not self._ready.is_set():
            self._ready.set()
            self._changed.set()
        else:
            self._on_result(message)
        if self._waiting is not None and self._pipe is not None:
            self._send(self._waiting)

    def _detach(self) -> None:
        if self._pipe is not None:
            self._loop.remove_reader(self._pipe.fileno())
            self._pipe.close()
        self._pipe, self._process, self._busy = None, None, True
        self._ready.clear()

    def _on_death(self) -> None:
        process = self._process
        self._detach()
        if process is not None:
            process.kill()
            process.join()
        self._restarts += 1
        if not self._closing and self._restarts <= RESTARTS_ALLOWED:
            self._start()
        self._changed.set()


def _end(process: multiprocessing.process.BaseProcess) -> None:
    process.join(KILL_AFTER_S)
    if process.is_alive():
        process.kill()
        process.join()

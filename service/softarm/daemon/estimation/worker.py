"""A process that solves one request after another; the newest one replaces one that still waits.

Numerics in a thread hold the interpreter's lock for tens of milliseconds; in a process they cannot delay
the control loop. Requests and results are small, so pipes carry them. The loop reads a result as it comes, in
as many parts as that takes, and a thread waits for the end of a process: the loop waits for neither.

A request is made when the process is free for it and all that has arrived by then has been read, since at a
high rate a packet ages while it waits for the estimate before it.
"""

import asyncio
import contextlib
import faulthandler
import gc
import logging
import multiprocessing
import os
import pickle
import signal
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

logger = logging.getLogger(__name__)
Request = TypeVar("Request")
Result = TypeVar("Result")
Solver = Callable[[Any], Any]


@dataclass(frozen=True)
class BuiltSolver:
    """What a factory builds in the child.

    Args:
        solve: Answers requests.
        report: What the parent receives once, before the first result.
        finish: Called after each answer has been sent, for what need not be in it.
        prepare: Called after that unless the next request has come already, for what makes that one faster.
    """

    solve: Solver
    report: Any = None
    finish: Callable[[], None] = lambda: None
    prepare: Callable[[], None] = lambda: None


SolverFactory = Callable[[], BuiltSolver]

NICER = 5
"""Numerics that fill a core give way to the control loop and the drivers."""
KILL_AFTER_S = 2.0
STUCK_S = 5.0
"""A request that takes longer is abandoned, and the process is killed."""
SWITCH_S = 2e-4
"""A solver's own threads hold the interpreter's lock no longer while a request waits for it."""
_LENGTH = struct.Struct("<Q")
_CHUNK = 1 << 16


@dataclass(frozen=True)
class RestartPolicy:
    """When a process that died is started again.

    Args:
        deaths: After so many deaths within the window it is not started again.
        window_s: A death counts for so long.
        pause_s: Wait before the first restart; each further death within the window doubles it.
        longest_pause_s: Longest wait.
        start_s: A process that is not ready after so long is stuck: compiling the kernels takes a minute,
            and many on a machine that is overloaded.
    """

    deaths: int = 6
    window_s: float = 600.0
    pause_s: float = 0.1
    longest_pause_s: float = 5.0
    start_s: float = 900.0


@dataclass(frozen=True)
class WorkerState:
    """What became of the process.

    Args:
        running: Whether it lives and has reported that it is ready.
        restarts: How often it was started again.
        gave_up: Whether it died too often to be started again.
        was_ready: Whether it has been ready at least once.
    """

    running: bool
    restarts: int
    gave_up: bool
    was_ready: bool = False

    @property
    def starting(self) -> bool:
        """Whether it is being built and has never been ready yet, however often it died meanwhile."""
        return not (self.running or self.gave_up or self.was_ready)


def _serve(requests: Connection, results: Connection, factory: SolverFactory, niceness: int) -> None:
    """Run in the child: build the solver, then answer until the pipe closes."""
    # Ctrl-C goes to the whole group; the parent decides when this process ends, by closing the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(PermissionError):  # a sandbox may forbid it
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    faulthandler.register(signal.SIGALRM, all_threads=True)  # shows in the log where it is stuck
    sys.setswitchinterval(SWITCH_S)
    inbox = _Inbox(requests)
    try:
        built = factory()
        gc.collect()
        gc.freeze()  # a collection of all parts of the solver takes tens of milliseconds
        _write(results, built.report)
        while True:
            request = inbox.wait()
            signal.setitimer(signal.ITIMER_REAL, 0.9 * STUCK_S)  # just before the parent kills it
            _write(results, built.solve(request))
            built.finish()
            if not requests.poll():
                built.prepare()
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    except (EOFError, BrokenPipeError):
        return


def _write(pipe: Connection, message: Any) -> None:
    """Write a message behind its length, for a reader that does not wait."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    left = memoryview(_LENGTH.pack(len(data)) + data)
    while left:
        left = left[os.write(pipe.fileno(), left) :]


class _Inbox:
    """Reads messages from a pipe, each behind its length, in as many parts as they come in."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._received = bytearray()

    def read(self) -> bool:
        """Read what has come; return whether the pipe is still open."""
        try:
            data = os.read(self._pipe.fileno(), _CHUNK)
        except BlockingIOError:
            return True
        self._received += data
        return bool(data)

    def messages(self) -> Iterator[Any]:
        """Return the messages that are complete."""
        received = self._received
        while len(received) >= _LENGTH.size:
            end = _LENGTH.size + _LENGTH.unpack_from(received)[0]
            if len(received) < end:
                return
            message = pickle.loads(received[_LENGTH.size : end])
            del received[:end]
            yield message

    def wait(self) -> Any:
        """Wait for the next message.

        Raises:
            EOFError: The pipe was closed.
        """
        while True:
            for message in self.messages():
                return message
            if not self.read():
                raise EOFError


@dataclass(eq=False)
class _Child:
    """One process with its pipes.

    Args:
        requests: Our end of the pipe to it.
        results: Our end of the pipe from it, which does not block.
        started_s: When it was started [s].
        ready: Whether it has reported that it is ready.
    """

    process: BaseProcess
    requests: Connection
    results: Connection
    started_s: float
    ready: bool = False

    def __post_init__(self) -> None:
        self.inbox = _Inbox(self.results)


class Worker(Generic[Request, Result]):
    """Owns the process; use it as an asynchronous context manager.

    Args:
        factory: Builds the solver in the child; it must be picklable.
        on_result: Called with each result, in the event loop.
        on_report: Called with the report of each new child once it is built, in the event loop.
        clock: Monotonic time [s].
        nicer: By how much the process gives way to this one.
        policy: When it is started again.
    """

    def __init__(
        self,
        factory: SolverFactory,
        on_result: Callable[[Result], None],
        on_report: Callable[[Any], None] = lambda _: None,
        *,
        clock: Callable[[], float] = time.monotonic,
        nicer: int = NICER,
        policy: RestartPolicy | None = None,
    ) -> None:
        self._factory = factory
        self._on_result = on_result
        self._on_report = on_report
        self._clock = clock
        self._niceness = os.getpriority(os.PRIO_PROCESS, 0) + nicer
        self._policy = policy or RestartPolicy()
        # Not forked: the threads of zenoh and numba would leave their locks held in the child.
        self._context = multiprocessing.get_context("spawn")
        self._loop = asyncio.get_running_loop()
        self._child: _Child | None = None
        self._waiting: Callable[[], Request | None] | None = None
        self._busy = True
        self._sent_s = clock()
        self._restarts = 0
        self._deaths: deque[float] = deque()
        self._gave_up = self._was_ready = False
        self._closing = False
        self._pause: asyncio.TimerHandle | None = None
        self.replaced = 0

    @property
    def state(self) -> WorkerState:
        """State of the process."""
        running = self._child is not None and self._child.ready
        return WorkerState(running, self._restarts, self._gave_up, self._was_ready)

    async def __aenter__(self) -> "Worker[Request, Result]":
        self._start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._closing = True
        if self._pause is not None:
            self._pause.cancel()
        child = self._child
        if child is not None:
            self._detach()
            await asyncio.to_thread(_end, child.process)

    def submit(self, make: Callable[[], Request | None]) -> None:
        """Make and send a request as soon as the process is free; it replaces one that still waits.

        Args:
            make: Makes the request, or ``None`` where there is nothing to request after all.
        """
        if self._busy or self._child is None:
            self.replaced += self._waiting is not None
            self._waiting = make
            return
        self._send(make, self._child)

    def watch(self) -> None:
        """Kill a process that is stuck at a request or at its start; call it at every tick."""
        child, now_s = self._child, self._clock()
        if child is None:
            return
        since_s, allowed_s = (
            (self._sent_s, STUCK_S) if child.ready else (child.started_s, self._policy.start_s)
        )
        if self._busy and now_s - since_s > allowed_s:
            what = "at one request" if child.ready else "being built"
            logger.warning("the estimator was %s for more than %g s; it is killed", what, allowed_s)
            # Counted anew, or every tick until the process is gone would kill it and log again.
            self._sent_s = child.started_s = now_s
            child.process.kill()

    def _send(self, make: Callable[[], Request | None], child: _Child) -> None:
        self._waiting = None
        request = make()
        if request is None:
            return
        self._busy, self._sent_s = True, self._clock()
        with contextlib.suppress(OSError):  # the end of the other pipe reports that of the process
            _write(child.requests, request)

    def _start(self) -> None:
        self._pause = None
        theirs_in, ours_out = self._context.Pipe(duplex=False)
        ours_in, theirs_out = self._context.Pipe(duplex=False)
        process = self._context.Process(
            target=_serve,
            args=(theirs_in, theirs_out, self._factory, self._niceness),
            name="softarm-estimator",
            daemon=True,
        )
        process.start()
        # While this process holds them open, the end of the child would not close the pipe.
        theirs_in.close()
        theirs_out.close()
        # A result may come in pieces; the loop must not wait for the rest of one.
        os.set_blocking(ours_in.fileno(), False)
        self._child = child = _Child(process, ours_out, ours_in, self._clock())
        self._busy = True
        self._loop.add_reader(ours_in.fileno(), self._receive, child)

    def _receive(self, child: _Child) -> None:
        """Handle the results that have come, and the end of the process, which closes its end of the pipe."""
        is_open = child.inbox.read()
        for message in child.inbox.messages():
            self._on_message(child, message)
        if not is_open:
            self._on_end(child)

    def _on_message(self, child: _Child, message: Any) -> None:
        # Messages of a child that was replaced meanwhile answer requests that nobody waits for.
        if child is not self._child:
            return
        self._busy = False
        if child.ready:
            self._on_result(message)
        else:
            child.ready = self._was_ready = True
            self._on_report(message)
        self._loop.call_soon(self._send_waiting)  # after what came together with this result

    def _send_waiting(self) -> None:
        if self._waiting is not None and self._child is not None and not self._busy:
            self._send(self._waiting, self._child)

    def _detach(self) -> None:
        if self._child is not None:
            self._loop.remove_reader(self._child.results.fileno())
            self._child.requests.close()
            self._child.results.close()
        self._child, self._busy = None, True

    def _on_end(self, child: _Child) -> None:
        if child is not self._child:
            return
        self._detach()
        # Its end of the pipe is closed, but a process that hangs in native code would never exit by itself.
        child.process.kill()
        threading.Thread(target=_end, args=(child.process,), name="softarm-reaper", daemon=True).start()
        now_s = self._clock()
        self._deaths.append(now_s)
        while now_s - self._deaths[0] > self._policy.window_s:
            self._deaths.popleft()
        self._restarts += 1
        self._start_again()

    def _start_again(self) -> None:
        deaths, policy = len(self._deaths), self._policy
        if self._closing:
            return
        if deaths >= policy.deaths:
            self._gave_up = True
            logger.error("the estimator died %d times; it is not started again", deaths)
            return
        pause_s = min(policy.pause_s * 2.0 ** (deaths - 1), policy.longest_pause_s)
        logger.warning(
            "the estimator died (%d of %d within %g s); it is restarted in %.1f s",
            deaths,
            policy.deaths,
            policy.window_s,
            pause_s,
        )
        self._pause = self._loop.call_later(pause_s, self._start)


def _end(process: BaseProcess) -> None:
    """Reap a process; in a thread, since this waits."""
    process.join(KILL_AFTER_S)
    if process.is_alive():
        process.kill()
        process.join(KILL_AFTER_S)

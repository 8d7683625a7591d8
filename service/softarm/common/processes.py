"""Processes for work beside this one."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context

from softarm.common.errors import WorkFailedError


@contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """Start processes for a block of work, from the main thread.

    A terminal sends Ctrl-C to all of them. Only this process obeys it: it ends the others, which would
    otherwise each print where they stood.

    Args:
        jobs: Number of processes.

    Raises:
        WorkFailedError: One of the processes ended by itself.
    """
    usual = signal.signal(signal.SIGINT, signal.SIG_IGN)  # what starts now inherits this
    try:
        executor = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))
        for _ in range(jobs):
            executor.submit(os.getpid)  # each starts one, as none is idle yet
    finally:
        signal.signal(signal.SIGINT, usual)
    try:
        yield executor
    except BaseException as error:
        for child in active_children():
            child.terminate()
        executor.shutdown(cancel_futures=True)
        if isinstance(error, BrokenProcessPool):
            what = "one of the processes was ended, perhaps for lack of memory; use fewer jobs"
            raise WorkFailedError(what) from error
        raise
    executor.shutdown()

"""Who does the independent work of a diagnosis: this process, others, or a Dask cluster."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from softarm.common.processes import processes
from softarm.estimator.errors import InputError


class Inline(Executor):
    """Runs work at once in this process."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run work and return its finished future."""
        future: Future[Any] = Future()
        try:
            future.set_result(work(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - the future raises it where the result is read
            future.set_exception(error)
        return future


@contextmanager
def workers(jobs: int, dask: str | None = None, patience: float = 10.0) -> Iterator[Executor]:
    """Return an executor.

    Args:
        jobs: Number of processes; 1 stays in this one.
        dask: Address of a Dask scheduler.
        patience: How long to wait for that [s].

    Raises:
        InputError: Dask is wanted and not installed, or not there.
    """
    if dask is not None:
        with _dask(dask, patience) as executor:
            yield executor
        return
    if jobs == 1:
        yield Inline()
        return
    with processes(jobs) as executor:
        yield executor


@contextmanager
def _dask(address: str, patience: float) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--dask", "Dask is not installed", "pip install distributed") from None
    try:
        client: Any = Client(address, timeout=patience)  # type: ignore[no-untyped-call]
    except (OSError, ValueError):
        cure = "give the address of a running one, such as tcp://10.0.0.5:8786"
        raise InputError("--dask", f"no scheduler answers at {address}", cure) from None
    with client:
        executor: Executor = client.get_executor()
        yield executor

"""Factoring the tangent in a thread while the caller goes on with the last factor."""

from threading import Condition, Thread
from types import TracebackType

from estimator.fem.model import FiniteElementModel
from estimator.fem.stiffness import Stiffness, take_stiffness
from estimator.mesh import Floats
from estimator.model import Inputs


class Refactoriser:
    """Owns one thread with a mailbox of one: the latest configuration offered is factored next.

    The kernels run without the interpreter's lock. Use it as a context manager.

    Args:
        model: Model whose tangent is factored.
    """

    def __init__(self, model: FiniteElementModel) -> None:
        self._model = model
        self._changed = Condition()
        self._request: tuple[Floats, Inputs] | None = None
        self._latest: Stiffness | None = None
        self._failure: Exception | None = None
        self._closing = False
        self._busy = False
        self._finished = 0
        self._thread = Thread(target=self._run, name="refactoriser", daemon=True)

    def __enter__(self) -> "Refactoriser":
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the thread finish what it has in hand, and end it."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    @property
    def latest(self) -> Stiffness | None:
        """The newest factor, None before the first is done."""
        with self._changed:
            return self._latest

    @property
    def finished(self) -> int:
        """Number of factorisations done."""
        with self._changed:
            return self._finished

    def offer(self, displacement: Floats, inputs: Inputs) -> None:
        """Ask for the factor at a configuration, in place of what was asked and not yet begun.

        Raises:
            RuntimeError: An earlier factorisation failed unexpectedly; the cause is attached.
        """
        with self._changed:
            if self._failure is not None:
                raise RuntimeError("the background factorisation failed") from self._failure
            self._request = (displacement, inputs)
            self._changed.notify_all()

    def wait(self) -> None:
        """Wait until nothing is asked or in hand."""
        with self._changed:
            self._changed.wait_for(lambda: self._closing or (self._request is None and not self._busy))

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._request is not None)
                if self._closing or self._request is None:
                    return
                (displacement, inputs), self._request, self._busy = self._request, None, True
            found, failure = self._take(displacement, inputs)
            with self._changed:
                self._latest = found if found is not None else self._latest
                self._failure = failure
                self._busy = False
                self._finished += 1
                self._changed.notify_all()
                if failure is not None:
                    return

    def _take(self, displacement: Floats, inputs: Inputs) -> tuple[Stiffness | None, Exception | None]:
        try:
            return take_stiffness(self._model, displacement, inputs), None
        except Exception as error:  # noqa: BLE001 (the boundary of the thread; handed to the caller)
            return None, error

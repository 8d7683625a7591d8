"""The thread with a mailbox of one."""

from threading import Event

import pytest

from softarm.estimator.background import Background


def test_what_waits_is_replaced_by_what_is_newer() -> None:
    begun, go_on, seen = Event(), Event(), []

    def work(number: int) -> int:
        seen.append(number)
        begun.set()
        go_on.wait()
        return -number

    with Background(work, "test") as background:
        assert background.idle
        background.ask(1)
        begun.wait()
        background.ask(2)
        background.ask(3)
        assert not background.idle
        go_on.set()
        background.wait()
        assert (seen, background.newest) == ([1, 3], -3)


def test_a_failure_reaches_whoever_asks_next() -> None:
    def work(number: int) -> int:
        return 1 // number

    with Background(work, "test") as background:
        background.ask(0)
        background.wait()
        with pytest.raises(RuntimeError, match="test failed") as caught:
            background.ask(1)
        assert isinstance(caught.value.__cause__, ZeroDivisionError)

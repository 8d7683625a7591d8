import asyncio
import os
import signal
from functools import partial

import pytest

from softarm.daemon.estimation.worker import STUCK_S, BuiltSolver, RestartPolicy, Worker


def double():
    return BuiltSolver(lambda value: 2 * value, "doubles")


def gated(path):
    def solve(value):
        with open(path) as gate:  # noqa: PTH123
            gate.read()
        return value

    return BuiltSolver(solve)


def dying():
    raise SystemExit(3)


def never_built():
    signal.pause()


class Results:
    def __init__(self):
        self.values = []
        self.arrived = asyncio.Event()

    def take(self, value):
        self.values.append(value)
        self.arrived.set()

    async def wait(self, count):
        while len(self.values) < count:
            self.arrived.clear()
            await self.arrived.wait()


async def until(worker, accept):
    while not accept(worker.state):  # noqa: ASYNC110
        await asyncio.sleep(0.005)


def pid_of(worker):
    return worker._child.process.pid


async def test_answers_and_ends():
    results = Results()
    async with Worker(double, results.take) as worker:
        await until(worker, lambda state: state.running)
        worker.submit(lambda: 21)
        await results.wait(1)
        pid = pid_of(worker)
    assert results.values == [42]
    assert not worker.state.running
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


async def test_mailbox_keeps_the_newest_only(tmp_path):
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    results = Results()
    async with Worker(partial(gated, str(gate)), results.take) as worker:
        await until(worker, lambda state: state.running)
        made = []
        for value in range(5):
            worker.submit(lambda value=value: made.append(value) or value)
        assert made == [0]
        for count in (1, 2):
            await asyncio.to_thread(gate.write_text, "go")
            await results.wait(count)
    assert results.values == made == [0, 4]
    assert worker.replaced == 3


def finishing(path):
    def finish():
        with open(path) as gate:  # noqa: PTH123
            gate.read()

    return BuiltSolver(lambda value: value, finish=finish)


async def test_a_result_does_not_wait_for_what_need_not_be_in_it(tmp_path):
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    results = Results()
    async with Worker(partial(finishing, str(gate)), results.take) as worker:
        await until(worker, lambda state: state.running)
        worker.submit(lambda: 4)
        await results.wait(1)
        await asyncio.to_thread(gate.write_text, "go")
    assert results.values == [4]


def preparing(finishes, prepares):
    prepared = []

    def wait(path):
        with open(path) as gate:  # noqa: PTH123
            gate.read()

    def prepare():
        wait(prepares)
        prepared.append(True)

    return BuiltSolver(lambda _: len(prepared), finish=lambda: wait(finishes), prepare=prepare)


async def test_the_next_request_is_prepared_only_while_none_waits(tmp_path):
    finishes, prepares = tmp_path / "finishes", tmp_path / "prepares"
    os.mkfifo(finishes)
    os.mkfifo(prepares)
    results = Results()
    async with Worker(partial(preparing, str(finishes), str(prepares)), results.take) as worker:
        await until(worker, lambda state: state.running)
        worker.submit(lambda: "first")
        worker.submit(lambda: "waits")
        await results.wait(1)
        while worker._waiting is not None:  # noqa: ASYNC110
            await asyncio.sleep(0)
        await asyncio.to_thread(finishes.write_text, "go")
        await results.wait(2)
        await asyncio.to_thread(finishes.write_text, "go")
        await asyncio.to_thread(prepares.write_text, "go")
        worker.submit(lambda: "third")
        await results.wait(3)
        await asyncio.to_thread(finishes.write_text, "go")
        await asyncio.to_thread(prepares.write_text, "go")
    assert results.values == [0, 0, 1]


async def test_the_next_request_is_made_after_what_came_with_the_result(tmp_path):
    """A reading that the loop has received together with a result belongs into the request after it."""
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    newest, results = ["old"], Results()
    loop = asyncio.get_running_loop()

    def take(value):
        loop.call_soon(newest.append, "new")  # as the handler of a packet that came at the same time
        results.take(value)

    async with Worker(partial(gated, str(gate)), take) as worker:
        await until(worker, lambda state: state.running)
        worker.submit(lambda: "first")
        worker.submit(lambda: newest[-1])
        for count in (1, 2):
            await asyncio.to_thread(gate.write_text, "go")
            await results.wait(count)
    assert results.values == ["first", "new"]


async def test_a_request_that_comes_to_nothing_leaves_the_process_free():
    results = Results()
    async with Worker(double, results.take) as worker:
        await until(worker, lambda state: state.running)
        worker.submit(lambda: None)
        worker.submit(lambda: 3)
        await results.wait(1)
    assert results.values == [6]


async def test_killed_process_is_started_again():
    results, reports = Results(), []
    async with Worker(double, results.take, reports.append) as worker:
        await until(worker, lambda state: state.running)
        first = pid_of(worker)
        os.kill(first, signal.SIGKILL)
        await until(worker, lambda state: state.running and state.restarts == 1)
        worker.submit(lambda: 1)
        await results.wait(1)
        assert pid_of(worker) != first
    assert results.values == [2]
    assert reports == ["doubles"] * 2


async def test_gives_up_on_a_process_that_keeps_dying_and_logs_each_death(caplog):
    policy = RestartPolicy(deaths=3, pause_s=0.01)
    async with Worker(dying, lambda _: None, policy=policy) as worker:
        await until(worker, lambda state: state.gave_up)
        assert worker.state.restarts == len(worker._deaths) == 3
        assert not worker.state.running
    assert caplog.text.count("it is restarted in") == 2
    assert "it is not started again" in caplog.text


async def test_deaths_long_ago_no_longer_count():
    now = [0.0]
    policy = RestartPolicy(deaths=2, pause_s=0.01, window_s=60.0)
    async with Worker(double, Results().take, clock=lambda: now[0], policy=policy) as worker:
        for restarts in range(1, 4):
            await until(worker, lambda state: state.running)
            now[0] += 100.0
            os.kill(pid_of(worker), signal.SIGKILL)
            await until(worker, lambda state, restarts=restarts: state.running and state.restarts == restarts)
        assert len(worker._deaths) == 1
        assert not worker.state.gave_up


async def test_process_that_is_stuck_while_it_is_built_is_killed():
    now = [0.0]
    policy = RestartPolicy(deaths=1, start_s=10.0)
    async with Worker(never_built, Results().take, clock=lambda: now[0], policy=policy) as worker:
        worker.watch()
        assert worker.state.starting
        assert worker.state.restarts == 0
        now[0] += 11.0
        worker.watch()
        await until(worker, lambda state: state.gave_up)


async def test_process_that_is_stuck_is_started_anew(tmp_path):
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    now = [0.0]
    async with Worker(partial(gated, str(gate)), Results().take, clock=lambda: now[0]) as worker:
        await until(worker, lambda state: state.running)
        worker.submit(lambda: "never answered")
        worker.submit(lambda: "waits")
        now[0] += STUCK_S + 1.0
        worker.watch()
        await until(worker, lambda state: state.restarts == 1 and state.running)

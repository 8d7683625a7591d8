import asyncio

from softarm.daemon.network.inbox import Inbox, serve_each


async def test_what_takes_long_keeps_nothing_waiting():
    inbox: Inbox[str] = Inbox(asyncio.get_running_loop(), 8)
    begun, done, disk, stopped = [], [], asyncio.Event(), asyncio.Event()

    async def serve(item):
        begun.append(item)
        if item == "record/stop":
            await disk.wait()
        if item == "stop":
            stopped.set()
        done.append(item)

    async with asyncio.TaskGroup() as tasks:
        serving = tasks.create_task(serve_each(inbox.take, serve, tasks))
        for item in ("arm", "record/stop", "set_pressures", "stop"):
            assert inbox.offer(item)
        await stopped.wait()
        assert begun == ["arm", "record/stop", "set_pressures", "stop"]
        assert done == ["arm", "set_pressures", "stop"]
        serving.cancel()
        disk.set()
    assert done[-1] == "record/stop"  # what was begun is brought to its end


async def test_what_does_not_fit_is_refused():
    inbox: Inbox[int] = Inbox(asyncio.get_running_loop(), 2)
    assert [inbox.offer(item) for item in range(3)] == [True, True, False]
    assert await inbox.take() == 0
    assert inbox.close() == (1,)
    assert not inbox.offer(4)

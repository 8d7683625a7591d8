"""The supervisor: one state, owned tasks, capped waits, staleness and loss, in virtual time."""

import asyncio
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.drivers.alarms import Alarms
from softarm.drivers.backoff import Backoff
from softarm.drivers.device import Device, close_all, connect_all
from softarm.drivers.errors import ConfigurationError, ConnectionLost, DeviceError, DeviceErrors
from softarm.drivers.health import Health
from softarm.drivers.supervisor import STALE, TRANSITIONS, ConnectionState, Supervisor, Timing

LOST = ConnectionLost("gauge", "was unplugged", "plug it in")
MISFIT = ConfigurationError("gauge", "is another device", "correct the port")


class ScriptedSession:
    """A session that follows one line of a script."""

    def __init__(self, script, log):
        self.script = script
        self.log = log

    async def identify(self):
        await self._step("identify")

    async def stream(self):
        await self._step("stream")

    async def close(self):
        self.log.append("close")

    async def _step(self, name):
        self.log.append(name)
        where, outcome, after_s = self.script
        if where != name:
            return
        await asyncio.sleep(after_s)
        if isinstance(outcome, BaseException):
            raise outcome


class Rig:
    """A supervisor whose sessions follow a script; the last line repeats."""

    def __init__(self, virtual, script, **timing):
        self.script = list(script)
        self.log = []
        self.changes = []
        self.opened_at = []
        self.virtual = virtual
        self.health = Health(Alarms(virtual.clock))
        self.supervisor = Supervisor(
            "gauge",
            self.open,
            self.health,
            timing=Timing(**{"stale_after_s": 1e5, **timing}),
            backoff=Backoff(jitter=0.0),
            random=Random(1),
            clock=virtual.clock,
            observer=lambda before, after: self.changes.append((before, after)),
        )

    async def open(self):
        self.opened_at.append(self.virtual.clock() / 1e9)
        script = self.script.pop(0) if len(self.script) > 1 else self.script[0]
        if script[0] == "open":
            await asyncio.sleep(script[2])
            if isinstance(script[1], BaseException):
                raise script[1]
        return ScriptedSession(script, self.log)


FOREVER = ("stream", LOST, 1e5)


def test_connect_streams_and_close_closes(virtual):
    rig = Rig(virtual, [FOREVER])

    async def main():
        await rig.supervisor.start()
        assert rig.supervisor.state is ConnectionState.STREAMING
        await asyncio.sleep(1)
        await rig.supervisor.stop()
        assert rig.supervisor.state is ConnectionState.DISCONNECTED
        assert rig.log == ["identify", "stream", "close"]

    virtual.run(main)


def test_waits_grow_to_the_cap_and_the_first_failure_is_told(virtual):
    rig = Rig(virtual, [("open", LOST, 0.0)])

    async def main():
        with pytest.raises(ConnectionLost, match="plug it in"):
            await rig.supervisor.start()
        await asyncio.sleep(40)
        await rig.supervisor.stop()

    virtual.run(main)
    waits = [round(b - a, 6) for a, b in zip(rig.opened_at, rig.opened_at[1:], strict=False)]
    assert waits[:8] == [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0]
    assert rig.health.failures == len(rig.opened_at)


def test_a_configuration_error_is_not_tried_again(virtual):
    rig = Rig(virtual, [("identify", MISFIT, 0.1)])

    async def main():
        with pytest.raises(ConfigurationError):
            await rig.supervisor.start()
        await asyncio.sleep(100)
        assert rig.supervisor.state is ConnectionState.FAULT
        assert not rig.supervisor.retrying
        await rig.supervisor.stop()

    virtual.run(main)
    assert len(rig.opened_at) == 1
    assert rig.log == ["identify", "close"]


def test_a_corrected_device_can_be_started_again(virtual):
    rig = Rig(virtual, [("identify", MISFIT, 0.1), FOREVER])

    async def main():
        with pytest.raises(ConfigurationError):
            await rig.supervisor.start()
        await rig.supervisor.start()
        assert rig.supervisor.state is ConnectionState.STREAMING
        await rig.supervisor.stop()

    virtual.run(main)


def test_waits_start_short_again_after_stable_streaming(virtual):
    failing = [("open", OSError("no route"), 0.0)] * 5
    rig = Rig(virtual, [*failing, ("stream", LOST, 10.0), FOREVER])

    async def main():
        with pytest.raises(ConnectionLost, match="no route"):
            await rig.supervisor.start()
        await rig.supervisor.wait_for(ConnectionState.STREAMING)
        await rig.supervisor.wait_for(ConnectionState.FAULT)
        lost_at = virtual.clock()
        await rig.supervisor.wait_for(ConnectionState.STREAMING)
        assert (virtual.clock() - lost_at) / 1e9 == pytest.approx(0.1)
        await rig.supervisor.stop()

    virtual.run(main)
    assert rig.health.reconnects == 1


def test_a_peer_that_never_opens_or_identifies_runs_into_a_deadline(virtual):
    for where in ("open", "identify"):
        rig = Rig(virtual, [(where, None, 1e5)], open_s=3.0, identify_s=2.0)

        async def main(rig=rig):
            with pytest.raises(ConnectionLost, match=r"limit [23]\.0 s"):
                await rig.supervisor.start()
            await rig.supervisor.stop()

        virtual.run(main)


def test_silence_degrades_and_the_next_valid_reading_recovers(virtual):
    rig = Rig(virtual, [FOREVER], stale_after_s=0.5)

    async def main():
        await rig.supervisor.start()
        began = virtual.clock()
        await rig.supervisor.wait_for(ConnectionState.DEGRADED)
        assert (virtual.clock() - began) / 1e9 == pytest.approx(0.5, abs=0.01)
        assert STALE in rig.health.alarms
        rig.supervisor.reading_arrived(valid=False)
        assert rig.supervisor.state is ConnectionState.DEGRADED
        rig.supervisor.reading_arrived(valid=True)
        assert rig.supervisor.state is ConnectionState.STREAMING
        await rig.supervisor.stop()

    virtual.run(main)


def test_invalid_readings_keep_the_connection_but_silence_loses_it(virtual):
    rig = Rig(virtual, [FOREVER], stale_after_s=0.5, lost_after_s=2.0)

    async def main():
        await rig.supervisor.start()
        for _ in range(30):
            await asyncio.sleep(0.2)
            rig.supervisor.reading_arrived(valid=False)
        assert rig.supervisor.state is ConnectionState.DEGRADED
        before = virtual.clock()
        await rig.supervisor.wait_for(ConnectionState.FAULT)
        assert (virtual.clock() - before) / 1e9 == pytest.approx(2.0, abs=0.01)
        await rig.supervisor.stop()

    virtual.run(main)


def test_a_driver_that_fails_is_reported_and_tried_again(virtual, caplog):
    rig = Rig(virtual, [("stream", ZeroDivisionError(), 1.0), FOREVER])

    async def main():
        await rig.supervisor.start()
        await rig.supervisor.wait_for(ConnectionState.FAULT)
        assert "ZeroDivisionError" in str(rig.health.last_error)
        await rig.supervisor.wait_for(ConnectionState.STREAMING)
        await rig.supervisor.stop()

    virtual.run(main)
    assert rig.log.count("close") == 2


def test_stop_while_connecting_answers_the_caller(virtual):
    rig = Rig(virtual, [("open", None, 2.0)])

    async def main():
        starting = asyncio.create_task(rig.supervisor.start())
        await asyncio.sleep(0.5)
        await rig.supervisor.stop()
        with pytest.raises(ConnectionLost, match="closed while"):
            await starting

    virtual.run(main)


def test_a_stop_also_ends_a_start_that_waits_for_a_failed_attempt_to_close(virtual):
    rig = Rig(virtual, [("open", MISFIT, 1.0)], stale_after_s=0.5, lost_after_s=2.0)

    async def main():
        first = asyncio.create_task(rig.supervisor.start())
        await asyncio.sleep(1.0)
        second = asyncio.create_task(rig.supervisor.start())
        await asyncio.sleep(0)
        await rig.supervisor.stop()
        outcomes = await asyncio.gather(first, second, return_exceptions=True)
        assert all(isinstance(outcome, DeviceError) for outcome in outcomes)

    virtual.run(main)
    assert rig.supervisor.state is ConnectionState.DISCONNECTED


outcomes = st.tuples(
    st.sampled_from(["open", "identify", "stream"]),
    st.sampled_from([LOST, MISFIT, OSError(5, "EIO"), ValueError("bug"), None]),
    st.floats(0, 8),
)
actions = st.tuples(st.sampled_from(["heard", "invalid", "alarm", "clear", "stop", "start"]), st.floats(0, 3))


@settings(max_examples=60, deadline=None)
@given(script=st.lists(outcomes, min_size=1, max_size=6), acts=st.lists(actions, max_size=12))
def test_any_history_follows_the_table_and_closes_what_it_opened(virtual, script, acts):
    rig = Rig(virtual, script, stale_after_s=0.5, lost_after_s=2.0)

    async def main():
        starts = []
        for verb, wait_s in acts:
            if verb in ("heard", "invalid"):
                rig.supervisor.reading_arrived(verb == "heard")
            elif verb == "alarm":
                rig.health.alarms.set("test", "is odd", "look")
            elif verb == "clear":
                rig.health.alarms.clear("test")
            elif verb == "stop":
                await rig.supervisor.stop()
            else:
                starts.append(asyncio.create_task(rig.supervisor.start()))
            await asyncio.sleep(wait_s)
        await rig.supervisor.stop()
        await asyncio.gather(*starts, return_exceptions=True)

    virtual.run(main)
    assert rig.supervisor.state is ConnectionState.DISCONNECTED
    assert all(after in TRANSITIONS[before] for before, after in rig.changes)
    assert rig.log.count("close") == rig.log.count("identify")
    if rig.health.alarms:
        assert rig.supervisor.state not in (ConnectionState.STREAMING,)


@given(first=st.floats(0.01, 1), cap=st.floats(1, 60), jitter=st.floats(0, 0.5), seed=st.integers())
def test_waits_never_exceed_the_cap_and_its_jitter(first, cap, jitter, seed):
    delays = Backoff(first, cap, 2.0, jitter).delays(Random(seed))
    for delay in (next(delays) for _ in range(50)):
        assert first * (1 - jitter) <= delay <= cap * (1 + jitter)


class ScriptedDevice(Device):
    def __init__(self, name, virtual, error):
        super().__init__(name, f"test://{name}", timing=Timing(stale_after_s=1e5), clock=virtual.clock)
        self.error = error

    async def open(self):
        if self.error is not None:
            raise self.error
        return ScriptedSession(FOREVER, [])


def test_connect_all_tells_every_failure_and_keeps_those_that_answer(virtual):
    devices = [ScriptedDevice("a", virtual, LOST), ScriptedDevice("b", virtual, None)]
    devices.append(ScriptedDevice("c", virtual, MISFIT))

    async def main():
        with pytest.raises(DeviceErrors, match="2 of 3") as caught:
            await connect_all(devices)
        assert [type(error) for error in caught.value.leaves()] == [ConnectionLost, ConfigurationError]
        assert devices[1].state is ConnectionState.STREAMING
        await close_all(devices)
        assert all(device.state is ConnectionState.DISCONNECTED for device in devices)

    virtual.run(main)


def test_leaving_safe_is_not_cut_short_by_a_second_cancellation(virtual):
    left_safe = []

    class Slow(ScriptedSession):
        async def close(self):
            await asyncio.sleep(0.5)
            left_safe.append(virtual.clock())

    async def open_session():
        return Slow(FOREVER, [])

    async def main():
        supervisor = Supervisor("valves", open_session, Health(Alarms(virtual.clock)), clock=virtual.clock)
        await supervisor.start()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await supervisor.stop()
        assert len(left_safe) == 1

    virtual.run(main)


def test_a_lost_device_is_a_fault_before_its_session_has_closed(virtual):
    class Slow(ScriptedSession):
        async def close(self):
            await asyncio.sleep(0.5)

    async def open_session():
        return Slow(("stream", LOST, 1.0), [])

    async def main():
        supervisor = Supervisor("valves", open_session, Health(Alarms(virtual.clock)), clock=virtual.clock)
        await supervisor.start()
        began = virtual.clock()
        await supervisor.wait_for(ConnectionState.FAULT)
        assert (virtual.clock() - began) / 1e9 == pytest.approx(1.0)
        await supervisor.stop()

    virtual.run(main)


class Deaf(ScriptedSession):
    """Loses the first cancellation, as `asyncio.wait_for` of Python 3.11 can."""

    def __init__(self, log):
        super().__init__(FOREVER, log)
        self.lost = 0

    async def stream(self):
        while True:
            try:
                await asyncio.sleep(1e5)
            except asyncio.CancelledError:
                self.lost += 1
                if self.lost > 1:
                    raise


@pytest.mark.parametrize("lost_after_s", [None, 2.0])
def test_a_lost_cancellation_delays_the_end_and_does_not_prevent_it(virtual, lost_after_s):
    log = []
    sessions = []

    async def open_session():
        sessions.append(Deaf(log))
        return sessions[-1]

    async def main():
        supervisor = Supervisor(
            "valves",
            open_session,
            Health(Alarms(virtual.clock)),
            timing=Timing(lost_after_s=lost_after_s),
            clock=virtual.clock,
        )
        await supervisor.start()
        if lost_after_s is not None:
            await supervisor.wait_for(ConnectionState.FAULT)
            await supervisor.wait_for(ConnectionState.STREAMING)
        await supervisor.stop()

    virtual.run(main)
    assert all(session.lost == 2 for session in sessions)
    assert log.count("close") == len(sessions)

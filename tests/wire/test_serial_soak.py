"""Random faults on every serial instrument at once: all come back, nothing leaks, nothing is invented."""

import asyncio
import math
import random
from collections import Counter
from functools import partial

import pytest

SECONDS = 8.0
KINDS = {
    "lutron": ({}, {}),
    "line_gauge": ({}, {}),
    "mark10": ({}, {}),
    "sauter": ({}, {"unit": "N"}),
    "bendlabs": ({"boot_s": 0.3}, {}),
    "bno08x_rvc": ({}, {}),
    "witmotion": ({"baud": 115200}, {"rate_hz": 50}),
    "xbus": ({}, {}),
    "quaternion_line": ({}, {"unit": 2, "rate_hz": 8}),
}
NO_CHECK = {"bit_flip", "byte_loss", "garbage", "offset"}
"""Faults that a format without a checksum cannot betray, or that are no fault of the reading."""
UNSEEN = {"sauter": {"unit"}, "bendlabs": {"dropout"}}


class Judge:
    """Checks the values of one instrument while none of the faults that it cannot see is about."""

    def __init__(self, rig):
        self.rig = rig
        self.wrong = Counter()
        self.excused = False
        self.zeroed = False

    def __call__(self, reading):
        value = reading.value
        if not reading.valid or self.excused:
            return
        if hasattr(value, "gross") and not self.zeroed and abs(value.gross - self.rig.state.cord_force) > 0.2:
            self.wrong[f"{reading.device} {value.gross:.2f} N"] += 1
        if hasattr(value, "quaternion") and abs(math.hypot(*value.quaternion) - 1) > 1e-6:
            self.wrong[f"{reading.device} no rotation"] += 1
        if hasattr(value, "angles") and max(abs(a) for pair in value.angles for a in pair) > 0.2:
            self.wrong[f"{reading.device} bend"] += 1


async def torment(rig, device, judge, chance):
    """Strike one device with one fault after the other."""
    board = rig.boards[device.name]
    faults = [fault for fault in board.catalogue.values() if fault.name not in UNSEEN.get(device.name, ())]
    end = rig.clock.now() + SECONDS
    while rig.clock.now() < end:
        fault = chance.choice(faults)
        judge.excused = fault.name in NO_CHECK
        judge.zeroed = judge.zeroed or fault.name == "operator_zero"
        rig.inject(device.name, fault.name)
        await asyncio.sleep(chance.uniform(0.1, 1.2))
        board.clear()
        await asyncio.sleep(chance.uniform(0.3, 0.6))
        judge.excused = False
    board.clear()


def fresh(device):
    latest = device.stream.latest
    stale_ns = 1e9 * device.timing.stale_after_s
    return latest is not None and latest.valid and device.clock() - latest.measured_ns <= stale_ns


@pytest.mark.parametrize("seed", [1])
def test_random_faults_on_all_serial_instruments_at_once(wire, seed):
    stray = []

    async def main():
        asyncio.get_running_loop().set_exception_handler(lambda _, context: stray.append(context))
        cord = {"section": "tip", "hook_m": (0.0, 0.0, -0.5), "length_m": 0.209}
        fakes = [{"name": kind, "kind": kind, **fake} for kind, (fake, _) in KINDS.items()]
        async with wire.bench(*fakes, cord=cord, step_s=0.02) as rig:
            pairs = []
            for kind, (_, table) in KINDS.items():
                port = str(rig.serial_ports[kind].link)
                device, readings = wire.driver({"name": kind, "kind": kind, "port": port, **table})
                judge = Judge(rig)
                pairs.append((device, readings, judge))
            await asyncio.gather(*(device.connect() for device, *_ in pairs))
            chance = random.Random(seed)
            strikes = (
                torment(rig, device, judge, random.Random(chance.random())) for device, _, judge in pairs
            )
            judging = asyncio.create_task(judge_all(pairs))
            await asyncio.gather(*strikes)
            for device, *_ in pairs:
                await wire.until(partial(fresh, device), within=30, what=f"{device.name} is back")
                assert device.health.sink_errors == 0
            judging.cancel()
            await asyncio.wait({judging})
            await asyncio.gather(*(device.close() for device, *_ in pairs))
            assert not sum((judge.wrong for *_, judge in pairs), Counter())
            assert all(len(readings.all) > 20 for _, readings, _ in pairs)

    wire.run(main, 20.0)
    assert stray == []


async def judge_all(pairs):
    """Hold new readings against the truth as they come."""
    seen = [0] * len(pairs)
    while True:
        await asyncio.sleep(0.01)
        for index, (_, readings, judge) in enumerate(pairs):
            for reading in readings.all[seen[index] :]:
                judge(reading)
            seen[index] = len(readings.all)

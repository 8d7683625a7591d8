"""What the loop reports of an estimate: to subscribers always, to a recording while one runs."""

import asyncio
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softarm.daemon.control.estimates import SHAPE_RATE_HZ
from softarm.recordings.load import load_recording
from tests.service.control.test_loop import Arm
from tests.service.standins import result

NODES = np.arange(12.0, dtype=np.float32).reshape(3, 4)


@pytest.fixture
def arm(tmp_path):
    """An arm whose force grows with every estimate, and whose surface is sent when it is asked for."""
    arm, count = Arm(tmp_path), itertools.count()
    estimator = arm.loop.estimates.process

    def submit(make):
        request = make()
        if request is not None:
            nodes = NODES if request.with_mesh else None
            loads = np.array([0.0, 0.0, 0.01 * next(count), 0.0])
            estimator._on_result(replace(result(request), nodes=nodes, loads=loads))

    estimator.submit = submit
    return arm


def test_the_surface_is_sent_ten_times_a_second_and_only_while_somebody_listens(arm):
    arm.step(100)
    assert arm.sink.shapes == []
    arm.sink.shape_wanted = True
    arm.step(100)
    assert len(arm.sink.shapes) == pytest.approx(SHAPE_RATE_HZ, abs=1)
    for shape in arm.sink.shapes:
        np.testing.assert_array_equal(np.frombuffer(shape, "<f4").reshape(-1, 4), NODES)


async def test_a_recording_holds_the_forces_that_were_published_while_it_ran(arm):
    await arm.demand("lease/acquire")
    arm.step(20)
    answer = await arm.send("record/start")
    before = len(arm.sink.of("estimate"))
    for _ in range(30):
        arm.step()
        await asyncio.sleep(0)
    published = arm.sink.of("estimate")[before:]
    await arm.demand("record/stop")
    recording = load_recording(Path(answer.applied["path"]))
    written = recording.columns["estimate_force_tip_x_n"]
    loads = [load.force_n[0] for estimate in published for load in estimate.loads if load.section == "tip"]
    assert len(loads) > 5
    np.testing.assert_allclose(written[np.isfinite(written)], loads)

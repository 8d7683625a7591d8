import io
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from softarm.daemon.control.recorder import PART_SUFFIX, Document, Recorder, RecorderError, Sample
from softarm.daemon.control.streams import RecordedStreams
from softarm.recordings import load_recording
from softarm.recordings.mcap_writer import Stamp, Stream

PRESSURES = Stream("pressures", ("chamber_0_pa", "chamber_1_pa"), "fake+modbus://127.0.0.1:502")


def sample(index):
    stamp = Stamp(index * 0.01, index * 10_000_000, index * 10_000_000, index)
    return Sample(PRESSURES, (1000.0 * index, float("nan")), stamp)


def test_recording_is_readable_when_stopped(tmp_path):
    recorder = Recorder(tmp_path / "made")
    path = recorder.start("run", {"specimen.toml": b"name = 'x'\n"})
    assert path.with_name(path.name + PART_SUFFIX).exists()
    for index in range(50):
        recorder.put(sample(index))
    recorder.put(Document("mode", {"mode": "IDLE"}, sample(50).stamp))
    assert recorder.stop() == (path, 0)
    recording = load_recording(path)
    np.testing.assert_allclose(recording.columns["pressure_0_pa"], 1000.0 * np.arange(50))
    assert np.isnan(recording.columns["pressure_1_pa"]).all()


def test_names_do_not_overwrite(tmp_path):
    recorder = Recorder(tmp_path)
    paths = []
    for _ in range(2):
        paths.append(recorder.start("run", {}))
        recorder.put(sample(0))
        recorder.stop()
    assert [path.name for path in paths] == ["run.mcap", "run-2.mcap"]


def test_second_start_and_stop_without_start_are_refused(tmp_path):
    recorder = Recorder(tmp_path)
    with pytest.raises(RecorderError, match="nothing is being recorded"):
        recorder.stop()
    recorder.start("run", {})
    with pytest.raises(RecorderError, match="stop it first"):
        recorder.start("run", {})
    recorder.stop()


def test_second_stop_is_refused_while_a_slow_disk_keeps_the_first_waiting(tmp_path):
    class Disk(io.FileIO):
        def write(self, data):
            free.wait(10.0)
            return super().write(data)

    free = threading.Event()
    free.set()
    recorder = Recorder(tmp_path, create=lambda path: Disk(path, "xb"))
    path = recorder.start("run", {})
    free.clear()
    recorder.put(sample(0))
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(recorder.stop)
        while not recorder.closing:
            assert not first.done()
        with pytest.raises(RecorderError, match="is being closed"):
            recorder.stop()
        free.set()
        assert first.result() == (path, 0)


def test_full_disk_is_said_and_nothing_passes_for_whole(tmp_path):
    recorder = Recorder(tmp_path, create=lambda _: open("/dev/full", "wb"))  # noqa: PTH123, SIM115
    path = recorder.start("run", {})
    for index in range(100):
        recorder.put(sample(index))
    with pytest.raises(RecorderError, match=r"No space left.*run\.mcap\.part"):
        recorder.stop()
    assert not path.exists()
    assert recorder.health().error


def test_nothing_is_queued_while_idle(tmp_path):
    recorder = Recorder(tmp_path)
    recorder.put(sample(0))
    assert recorder.health().dropped == 0


def test_a_set_of_readings_that_is_estimated_twice_can_be_read_again(tmp_path):
    recorder = Recorder(tmp_path)
    streams = RecordedStreams(recorder, (), "valves", "", 2, clock_ns=lambda: 0)
    path = recorder.start("run", {})
    streams.commanded((0.0, 0.0), 0)
    for force, time_s in ((0.1, 1.0), (0.2, 1.0), (0.3, 1.5)):
        streams.estimated({"force_tip_x_n": force}, time_s)
    recorder.stop()
    recording = load_recording(path)
    np.testing.assert_allclose(recording.time, [0.0, 1.0, 1.0, 1.5], atol=2e-6)
    np.testing.assert_allclose(recording.columns["estimate_force_tip_x_n"][1:], [0.1, 0.2, 0.3])


def test_the_time_of_each_recording_counts_from_its_beginning(tmp_path):
    recorder, now = Recorder(tmp_path), [40_000_000_000]
    streams = RecordedStreams(recorder, (), "valves", "", 2, clock_ns=lambda: now[0])
    for _ in range(2):
        path = recorder.start("run", {})
        for _ in range(3):
            streams.commanded((0.0, 0.0), now[0])
            now[0] += 1_000_000_000
        recorder.stop()
        np.testing.assert_allclose(load_recording(path).time, [0.0, 1.0, 2.0], atol=1e-9)

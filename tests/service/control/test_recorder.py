import io
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from softarm.daemon.config import load_config
from softarm.daemon.control import recorder as recorder_module
from softarm.daemon.control.recorder import PART_SUFFIX, Document, Recorder, RecorderError, Sample
from softarm.daemon.control.recording_header import recording_header
from softarm.daemon.control.streams import RecordedStreams
from softarm.recordings import load_recording, save_recording
from softarm.recordings.mcap_writer import RecordTimes, Start, Topic

DEPLOYED = Path(__file__).parents[3] / "deploy" / "config" / "sopra.toml"
UNIX_NS = 1_790_000_000_000_000_000
PRESSURES = Topic("pressures", ("chamber_0_pa", "chamber_1_pa"), "fake+modbus://127.0.0.1:502")


def sample(index):
    stamp = RecordTimes(index * 0.01, index * 10_000_000, index * 10_000_000, index)
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
    recorder = Recorder(tmp_path, create=lambda path: io.BufferedWriter(Disk(path, "xb")))
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
    recorder = Recorder(tmp_path, clocks=lambda: Start(0, UNIX_NS))
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
    now = [40_000_000_000]
    recorder = Recorder(tmp_path, clocks=lambda: Start(now[0], UNIX_NS))
    streams = RecordedStreams(recorder, (), "valves", "", 2, clock_ns=lambda: now[0])
    for _ in range(2):
        path = recorder.start("run", {})
        for _ in range(3):
            streams.commanded((0.0, 0.0), now[0])
            now[0] += 1_000_000_000
        recorder.stop()
        np.testing.assert_allclose(load_recording(path).time, [0.0, 1.0, 2.0], atol=1e-9)


def ended(recorder):
    """Wait until the recording has ended by itself."""
    run = recorder._run
    if run is not None:
        run.ended.result(10.0)


def test_any_failure_of_the_writer_ends_the_recording_and_is_reported(tmp_path, caplog):
    recorder = Recorder(tmp_path)
    recorder.start("run", {})
    recorder.put(sample(0))
    recorder.put(Sample(PRESSURES, (1.0,), sample(1).stamp))  # a value less than the stream has fields
    ended(recorder)
    health = recorder.health()
    assert not health.active
    assert "ValueError" in health.error
    assert "run.mcap.part" in health.error
    assert "Traceback" in caplog.text
    with pytest.raises(RecorderError, match="ValueError"):
        recorder.stop()
    assert recorder.start("next", {}).name == "next.mcap"
    recorder.stop()


def test_stopping_does_not_wait_for_ever_for_a_disk_that_hangs(tmp_path, monkeypatch):
    class Disk(io.FileIO):
        def write(self, data):
            free.wait(30.0)
            return super().write(data)

    monkeypatch.setattr(recorder_module, "CLOSE_S", 0.1)
    free = threading.Event()
    free.set()
    recorder = Recorder(tmp_path, create=lambda path: io.BufferedWriter(Disk(path, "xb")))
    path = recorder.start("run", {})
    run = recorder._run
    free.clear()
    for index in range(recorder_module.QUEUE_LENGTH + 500):
        recorder.put(sample(index))
    with pytest.raises(RecorderError, match=r"still being closed.*did not answer"):
        recorder.stop()
    with pytest.raises(RecorderError, match="stop it first"):
        recorder.start("next", {})
    free.set()
    run.ended.result(20.0)
    assert path.exists()
    assert recorder.start("next", {}).name == "next.mcap"
    recorder.stop()


def test_starting_does_not_wait_for_ever_for_a_directory_that_hangs(tmp_path, monkeypatch):
    def create(path):
        free.wait(30.0)
        return path.open("xb")

    monkeypatch.setattr(recorder_module, "OPEN_S", 0.1)
    free = threading.Event()
    recorder = Recorder(tmp_path, create=create)
    with pytest.raises(RecorderError, match="did not answer within"):
        recorder.start("run", {})
    run = recorder._run
    free.set()
    run.ended.result(10.0)
    assert list(tmp_path.iterdir()) == []
    assert recorder.path is None


def test_a_recording_ends_whole_before_the_disk_is_full(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "SPACE_CHECK_S", 0.05)
    left = [10**12]
    recorder = Recorder(tmp_path, find_free_space=lambda _: left[0])
    path = recorder.start("run", {})
    run = recorder._run
    for index in range(50):
        recorder.put(sample(index))
    left[0] = 499_000_000
    run.ended.result(10.0)
    assert recorder.path is None
    assert "499 MB are left" in recorder.health().error
    with pytest.raises(RecorderError, match="499 MB are left"):
        recorder.stop()
    assert len(load_recording(path).time) > 0
    with pytest.raises(RecorderError, match="499 MB are left"):
        recorder.start("run", {})


def test_every_recording_says_when_where_and_by_whom_it_was_made(tmp_path):
    setup = load_config(DEPLOYED)
    start = Start(7_000_000_000, UNIX_NS)
    recorder = Recorder(tmp_path, header=recording_header(setup), clocks=lambda: start)
    path = recorder.start("run", {}, {"started_by": "alice"})
    stamp = RecordTimes(0.5, start.monotonic_ns + 510_000_000, 42, 3)
    recorder.put(Sample(PRESSURES, (1000.0, 2000.0), stamp))
    recorder.stop()
    info = load_recording(path).info
    assert info["arm"] == setup.config.arm
    assert info["specimen"] == "sopra"
    assert info["configuration"] == str(DEPLOYED)
    assert info["started_by"] == "alice"
    assert {"softarm_version", "host"} <= info.keys()
    assert info["started"] == "2026-09-21T14:13:20.000+00:00"
    assert info["started_unix_ns"] == UNIX_NS
    assert info["unix_minus_monotonic_ns"] == UNIX_NS - 7_000_000_000
    with path.open("rb") as file:
        reader = make_reader(file)
        _, _, message = next(reader.iter_messages(topics=["pressures"]))
        metadata = next(record.metadata for record in reader.iter_metadata())
    assert message.log_time == UNIX_NS + 510_000_000
    assert message.publish_time == UNIX_NS + 500_000_000
    content = json.loads(message.data)
    assert content["host_monotonic_ns"] == stamp.host_ns
    assert content["device_time_ns"] == 42
    assert (metadata["arm"], metadata["started_by"]) == (setup.config.arm, "alice")


def test_the_date_survives_a_conversion(tmp_path):
    recorder = Recorder(tmp_path, header={"arm": "left"}, clocks=lambda: Start(0, UNIX_NS))
    path = recorder.start("run", {})
    recorder.put(sample(3))
    recorder.stop()
    recording = load_recording(path)
    save_recording(recording, tmp_path / "run.csv")
    save_recording(load_recording(tmp_path / "run.csv"), tmp_path / "again.mcap")
    assert load_recording(tmp_path / "again.mcap").info == recording.info
    with (tmp_path / "again.mcap").open("rb") as file:
        _, _, message = next(make_reader(file).iter_messages())
    assert message.log_time == UNIX_NS + 30_000_000

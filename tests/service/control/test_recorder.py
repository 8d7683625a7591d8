import numpy as np
import pytest

from service.control.recorder import PART_SUFFIX, Document, Recorder, RecorderError, Sample
from service.recordings import load_recording
from service.recordings.mcap_writer import Stamp, Stream

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

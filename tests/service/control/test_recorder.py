import resource

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


@pytest.fixture
def small_files():
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_failing_write_is_said_and_the_part_kept(tmp_path, small_files):
    recorder = Recorder(tmp_path)
    path = recorder.start("run", {})
    noise = np.random.default_rng(0).standard_normal((400, 2))
    for index, values in enumerate(noise):
        recorder.put(Sample(PRESSURES, tuple(values), sample(index).stamp))
    with pytest.raises(RecorderError, match=r"run\.mcap\.part"):
        recorder.stop()
    assert not path.exists()
    assert path.with_name(path.name + PART_SUFFIX).exists()
    assert recorder.health().error


def test_nothing_is_queued_while_idle(tmp_path):
    recorder = Recorder(tmp_path)
    recorder.put(sample(0))
    assert recorder.health().dropped == 0

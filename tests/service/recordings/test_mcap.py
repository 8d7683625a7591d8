import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Message

from softarm.cli import run
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.recordings import load_events, load_recording, read_attachments, save_recording
from softarm.recordings.mcap_writer import NANOSECONDS, RecordTimes, Start, StreamWriter, Topic

PRESSURES = Topic("pressures", ("chamber_0_pa", "chamber_1_pa"), "fake+modbus://x")
MARKER = Topic("marker/tip1", ("x_m", "y_m", "z_m"))


def stamp(tick: int, device_delay_ns: int = 0) -> RecordTimes:
    host_ns = 5 * NANOSECONDS + tick * 10_000_000
    return RecordTimes(tick * 0.01, host_ns, host_ns - device_delay_ns, tick)


def test_every_stamp_and_schema_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = StreamWriter(file, [PRESSURES, MARKER], attachments={"specimen.toml": b"a = 1\n"})
        for tick in range(200):
            writer.write("pressures", [3e4, tick], stamp(tick, 7))
            if tick % 4 == 0:
                writer.write("marker/tip1", [0.1, float("nan"), 0.3], stamp(tick))
        writer.write_document("mode", {"mode": "HOLDING"}, stamp(200))
        writer.finish()
    recording = load_recording(path)
    assert len(recording.time) == 200
    assert recording.marker("tip1")[4].tolist()[::2] == [0.1, 0.3]
    assert read_attachments(path) == {"specimen.toml": b"a = 1\n"}
    with path.open("rb") as file:
        schema, channel, message = next(make_reader(file).iter_messages(topics=["pressures"]))
    assert schema is not None
    assert json.loads(schema.data)["properties"]["chamber_0_pa"]["description"].startswith("[Pa, gauge]")
    assert channel.metadata == {"source": "fake+modbus://x"}
    assert (message.log_time, message.publish_time) == (5 * NANOSECONDS, 5 * NANOSECONDS - 7)


@pytest.mark.parametrize(("lost", "samples"), [(1, 401), (333, 401), (2500, 301)])
def test_a_file_cut_off_opens_up_to_its_last_chunk(lost: int, samples: int, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap.part"
    with path.open("wb") as file:
        writer = StreamWriter(file, [PRESSURES], attachments={"recording.toml": b'specimen = "sopra"\n'})
        for tick in range(451):
            writer.write("pressures", [1e4, 2e4 + tick], stamp(tick))
        size = file.tell()
    # Killed here: the last half second was never flushed, and the disk lost some bytes of the index of the
    # last chunk (1.6 kB), or of the chunk itself.
    path.write_bytes(path.read_bytes()[: size - lost])
    recording = load_recording(path)
    assert len(recording.time) == samples
    assert recording.name == "run"
    assert recording.info["specimen"] == "sopra"
    assert "cut off" in recording.info["recovered"]


def test_every_second_is_on_the_disk(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap.part"
    with path.open("wb") as file:
        writer = StreamWriter(file, [PRESSURES])
        for tick in range(250):
            writer.write("pressures", [1e4, 2e4 + tick], stamp(tick))
        seen = len(load_recording(path).time)
    assert seen == 201


def written(path: Path, seconds: int) -> bytes:
    """Write a recording at 100 Hz with a chunk a second, as the service does."""
    with path.open("wb") as file:
        writer = StreamWriter(file, [PRESSURES], attachments={"specimen.toml": b"a = 1\n"})
        for tick in range(100 * seconds):
            writer.write("pressures", [1e4, 2e4 + tick % 97], stamp(tick))
        writer.finish()
    return path.read_bytes()


def test_one_flipped_byte_costs_its_chunk_and_no_more(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    data = bytearray(written(path, 24))
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    recording = load_recording(path)
    (begin, end) = recording.info["lost_s"][0]
    assert len(recording.info["lost_s"]) == 1
    assert 0.5 < end - begin < 1.2
    missing = np.setdiff1d(np.round(np.arange(2400) * 0.01, 2), np.round(recording.time, 2))
    assert 0 < len(missing) <= 101
    assert begin < missing[0]
    assert missing[-1] < end
    assert f"from {begin:.3f} s to {end:.3f} s" in recording.info["recovered"]
    assert "cut off" not in recording.info["recovered"]


@pytest.mark.parametrize("seed", range(6))
def test_a_flipped_byte_anywhere_never_costs_more_than_a_chunk(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    whole = written(path, 6)
    rng = np.random.default_rng(seed)
    for position in rng.integers(0, len(whole), 12):
        data = bytearray(whole)
        data[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        recording = load_recording(path)
        lost = 600 - len(recording.time)
        assert lost <= 101, (position, lost)
        assert not lost or recording.info["lost_s"], position


def test_a_lost_first_chunk_costs_no_later_message(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    data = bytearray(written(path, 5))
    first = data.index(b"\x04\x00\x00\x00zstd")
    data[first + 200] ^= 0xFF
    path.write_bytes(data)
    recording = load_recording(path)
    assert len(recording.time) == 500 - 101
    assert recording.info["lost_s"] == [[0.0, 1.01]]


def test_recordings_without_a_date_are_still_read(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    written(path, 2)
    assert len(load_recording(path).time) == 200
    assert "started" not in load_recording(path).info


def test_two_messages_at_one_time_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = StreamWriter(file, [PRESSURES])
        for _ in range(2):
            writer.write("pressures", [1e4, 0], stamp(3))
        writer.finish()
    with pytest.raises(InputError, match="has two messages of the same time"):
        load_recording(tmp_path / "run.mcap")


def kept(path: Path) -> list[tuple[object, ...]]:
    """List the messages of a file with all that belongs to them."""
    with path.open("rb") as file:
        return [
            (
                channel.topic,
                channel.metadata,
                schema and (schema.name, schema.data),
                stamps(message),
                message.data,
            )
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False)
        ]


def stamps(message: Message) -> tuple[int, int, int]:
    """Return all that says when a message came."""
    return message.sequence, message.log_time, message.publish_time


@pytest.mark.parametrize("cut_off", [True, False])
def test_a_conversion_to_mcap_keeps_every_message_as_it_is(tmp_path: Path, *, cut_off: bool) -> None:
    attachments = {
        "recording.toml": b'arm = "one"\n',
        "specimen.toml": b"a = 1\n",
        "service.toml": b"b = 1\n",
    }
    whole, part, copy = (tmp_path / name for name in ("whole.mcap", "run.mcap.part", "run.mcap"))
    start = Start(4 * NANOSECONDS, 1_700_000_000 * NANOSECONDS)
    with whole.open("wb") as file:
        writer = StreamWriter(file, [PRESSURES, MARKER], attachments=attachments, start=start)
        for tick in range(300):
            writer.write("pressures", [3e4, tick], stamp(tick, 7))
        writer.write_document("event", {"kind": "mode", "where": "one", "text": "armed"}, stamp(300))
        writer.flush()
        size = file.tell()
        writer.finish()
    part.write_bytes(whole.read_bytes()[:size] if cut_off else whole.read_bytes())
    assert run(["convert", str(part), str(copy)]) == 0
    assert kept(copy) == kept(whole)
    assert load_events(copy) == load_events(whole) != ()
    assert read_attachments(copy) == read_attachments(part) == read_attachments(whole)
    info = load_recording(copy).info
    assert (info["arm"], "recovered" in info) == ("one", cut_off)
    assert run(["convert", str(part), str(copy)]) == 2
    assert run(["convert", str(part), str(copy), "--force"]) == 0


@pytest.mark.parametrize("number", [0.0, -9999.0])
@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_values_that_an_intake_corrects_are_refused_only_without_one(
    tmp_path: Path, suffix: str, number: float
) -> None:
    time = 0.05 * np.arange(100)
    names = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
    pose = dict(zip(names, (12.0, 8.0, 276.0, 1.0, 0.0, 0.0, 0.0), strict=True))
    columns = {f"frame_tip_{name}": np.where(time < 1.0, number, value) for name, value in pose.items()}
    columns["pressure_0_pa"] = 30.0 + 10.0 * np.sin(time)
    path = tmp_path / f"run{suffix}"
    save_recording(Recording("run", time, columns), path)
    with pytest.raises(InputError, match="cannot be"):
        load_recording(path)
    read = load_recording(path, units_checked=False)
    for name, values in columns.items():
        np.testing.assert_array_equal(read.columns[name], values)

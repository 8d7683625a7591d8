import json
from pathlib import Path

import pytest
from mcap.reader import make_reader

from softarm.estimator.errors import InputError
from softarm.recordings import load_recording, read_attachments
from softarm.recordings.mcap_writer import NANOSECONDS, Stamp, Stream, StreamWriter

PRESSURES = Stream("pressures", ("chamber_0_pa", "chamber_1_pa"), "fake+modbus://x")
MARKER = Stream("marker/tip1", ("x_m", "y_m", "z_m"))


def stamp(tick: int, device_delay_ns: int = 0) -> Stamp:
    host_ns = 5 * NANOSECONDS + tick * 10_000_000
    return Stamp(tick * 0.01, host_ns, host_ns - device_delay_ns, tick)


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


def test_a_damaged_chunk_ends_the_reading(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = StreamWriter(file, [PRESSURES])
        for tick in range(400):
            writer.write("pressures", [1e4, 2e4 + tick], stamp(tick))
        writer.finish()
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    recording = load_recording(path)
    assert 0 < len(recording.time) < 400
    assert "recovered" in recording.info


def test_two_messages_at_one_time_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = StreamWriter(file, [PRESSURES])
        for _ in range(2):
            writer.write("pressures", [1e4, 0], stamp(3))
        writer.finish()
    with pytest.raises(InputError, match="has two messages of the same time"):
        load_recording(tmp_path / "run.mcap")

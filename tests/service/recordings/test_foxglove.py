"""A live recording, read by the plain ``mcap`` library and by the published parsers of its schemas."""

import json
import shutil
import subprocess
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from softarm.daemon.config import SensorSettings
from softarm.daemon.control.recorder import Recorder
from softarm.daemon.control.streams import SHAPE_EVERY_NS, RecordedStreams, estimate_columns
from softarm.recordings import load_events, load_recording, save_recording
from softarm.recordings.events import RecordedEvent
from softarm.recordings.mcap_writer import Start
from softarm.recordings.scene import METRES_PER_NEWTON
from softarm_client.messages import Estimate, LoadEstimate, SectionPose
from tests.service.standins import channel_reading

PARSER = Path(__file__).with_name("foxglove")
MONOTONIC_NS, UNIX_NS = 10**12, 1_790_000_000_000_000_000
STEP_NS = 10_000_000
TICKS = 120
PLAIN = {"number", "integer", "string"}
"""Types that every viewer of JSON Schema takes; a union of types is refused by some."""
FORCE = (0.3, -0.1, 0.05)
TIP = (0.01, 0.0, 0.27)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
TRIANGLES = ((0, 1, 2), (0, 2, 3))
NODES = np.array([[0, 0, 0, 1], [1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]], dtype=np.float32)
SENSORS = [SensorSettings(kind=kind, section="tip", device=kind) for kind in ("pose", "bend", "gauge")]
KNOWN = 1e-4
LOAD = LoadEstimate(
    section="tip", force_n=FORCE, covariance_n2=((KNOWN, 0.0, None), (0.0, KNOWN, None), (None,) * 3)
)
SECTIONS = (
    SectionPose(section="base", position_m=(0.0, 0.0, 0.0), quaternion_wxyz=UPRIGHT),
    SectionPose(section="tip", position_m=TIP, quaternion_wxyz=UPRIGHT, position_std_m=(1e-3,) * 3),
)
ESTIMATE = Estimate.model_construct(loads=(LOAD,))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Record what a service records in a second and a bit, a gauge of which every other reading is lost."""
    now = [MONOTONIC_NS]
    recorder = Recorder(tmp_path_factory.mktemp("live"), clocks=lambda: Start(MONOTONIC_NS, UNIX_NS))
    streams = RecordedStreams(recorder, SENSORS, "valves", "qtm/base", 2, lambda: now[0], TRIANGLES)
    path = recorder.start("run", {}, {"arm": "sopra", "specimen": "sopra"})
    streams.document("mode", {"before": "IDLE", "after": "ARMED", "cause": "arm", "by": "ann"})
    streams.document("event", {"kind": "mode", "where": "sopra", "text": "armed", "by": "ann"})
    streams.document("command", {"verb": "arm", "mode": "ARMED", "applied": {"asked_pa": [0.0, 0.0]}})
    for tick in range(TICKS):
        now[0] = MONOTONIC_NS + tick * STEP_NS
        readings = {"valves": (1e4, np.nan), "pose": (*TIP, *UPRIGHT), "qtm/base": (0.0, 0.0, 0.0, *UPRIGHT)}
        readings |= {"bend": (0.1, 0.2), "gauge": (np.nan if tick % 2 else 0.3,)}
        for device, values in readings.items():
            streams.record_reading(channel_reading(device, values, now[0], "fake"))
        streams.commanded((1e4, 0.0), now[0])
        streams.estimated(estimate_columns(ESTIMATE, SECTIONS), now[0] * 1e-9)
        if streams.shape_wanted:
            streams.shaped(NODES, now[0] * 1e-9)
    recorder.stop()
    return path


@pytest.fixture(scope="module")
def messages(path):
    """Every message by topic, decoded: Foxglove's schemas by their descriptors, the rest as JSON."""
    by_topic = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            decoder = DecoderFactory().decoder_for(channel.message_encoding, schema)
            decoded = json.loads(message.data) if decoder is None else decoder(message.data)
            by_topic.setdefault(channel.topic, []).append((schema, message, decoded))
    return by_topic


def test_every_channel_is_read_by_its_published_schema(path, messages):
    with path.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    assert {channel.topic for channel in channels} == set(messages)
    encodings = {topic: rows[0][0].encoding for topic, rows in messages.items()}
    assert {t for t, encoding in encodings.items() if encoding == "protobuf"} == {"/frames", "/scene"}
    for topic, rows in messages.items():
        for schema, _, decoded in rows:
            if encodings[topic] == "jsonschema":
                jsonschema.validate(decoded, json.loads(schema.data))
    assert messages["/frames"][0][0].name == "foxglove.FrameTransforms"
    assert messages["/scene"][0][0].name == "foxglove.SceneUpdate"


def test_numbers_are_plain_and_lost_ones_left_out(messages):
    for rows in messages.values():
        schema = rows[0][0]
        if schema.encoding == "jsonschema":
            types = [entry["type"] for entry in json.loads(schema.data)["properties"].values()]
            assert all(isinstance(kind, str) and kind in PLAIN for kind in types)
            assert all(value is not None for _, _, decoded in rows for value in decoded.values())
    assert all("chamber_1_pa" not in decoded for _, _, decoded in messages["pressures"])
    assert ["force_n" in decoded for _, _, decoded in messages["gauge/tip"]][:4] == [True, False] * 2


def test_log_times_are_unix_times(messages):
    for rows in messages.values():
        times = [message.log_time for _, message, _ in rows]
        assert min(times) >= UNIX_NS
        assert max(times) <= UNIX_NS + TICKS * STEP_NS


def test_the_force_is_an_arrow_at_its_section(messages):
    updates = [decoded for _, _, decoded in messages["/scene"]]
    arrows = [e for update in updates for e in update.entities if e.id == "force/tip"]
    arrow = arrows[0].arrows[0]
    pose = arrow.pose
    direction = Rotation.from_quat([getattr(pose.orientation, k) for k in ("x", "y", "z", "w")]).apply(
        [arrow.shaft_length, 0.0, 0.0]
    )
    np.testing.assert_allclose(direction, METRES_PER_NEWTON * np.array(FORCE), atol=1e-9)
    assert (pose.position.x, pose.position.y, pose.position.z) == TIP
    assert arrows[0].frame_id == "base"


def test_the_surface_is_a_list_of_triangles_twice_a_second(messages):
    updates = [decoded for _, _, decoded in messages["/scene"]]
    surfaces = [e.triangles[0] for update in updates for e in update.entities if e.id == "surface"]
    assert len(surfaces) == 1 + (TICKS - 1) * STEP_NS // SHAPE_EVERY_NS
    assert list(surfaces[0].indices) == [0, 1, 2, 0, 2, 3]
    assert [(p.x, p.y, p.z) for p in surfaces[0].points] == [tuple(node[:3]) for node in NODES.tolist()]


def test_frames_form_one_tree(messages):
    parents = {
        transform.child_frame_id: transform.parent_frame_id
        for _, _, decoded in messages["/frames"]
        for transform in decoded.transforms
    }
    assert parents == {
        "measured/base": "laboratory",
        "measured/tip": "laboratory",
        "base": "measured/base",
        "tip": "base",
    }


def test_a_converted_estimate_is_drawn_like_that_of_the_service(path, messages, tmp_path):
    (again,) = save_recording(load_recording(path), tmp_path / "again.mcap")
    with again.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [update for *_, update in reader.iter_decoded_messages("/scene")]
    arrows = [entity.arrows[0] for update in decoded for entity in update.entities]
    drawn = [e.arrows[0] for _, _, d in messages["/scene"] for e in d.entities if e.arrows]
    assert list(map(str, arrows)) == list(map(str, drawn))  # one message, of two classes


def test_it_reads_back_with_deviations_and_poses(path):
    recording = load_recording(path)
    gauge = recording.columns["gauge_tip_n"]
    assert np.isfinite(gauge).sum() == TICKS // 2
    assert np.isnan(recording.columns["pressure_1_pa"]).all()
    assert np.nanmax(recording.columns["estimate_force_tip_x_std_n"]) == pytest.approx(1e-2)
    assert np.isnan(recording.columns["estimate_force_tip_z_std_n"]).all()
    assert np.nanmax(recording.columns["estimate_frame_tip_z_m"]) == pytest.approx(TIP[2])
    assert np.nanmax(recording.columns["estimate_frame_tip_z_std_m"]) == pytest.approx(1e-3)


def test_events_read_back(path, tmp_path):
    assert load_events(path) == (RecordedEvent(0.0, "mode", "sopra", "armed"),)
    table, *_ = save_recording(load_recording(path), tmp_path / "run.csv")
    assert load_events(table) == ()  # no table holds them


def test_a_recording_with_null_for_lost_readings_still_reads(tmp_path):
    path = tmp_path / "old.mcap"
    number = {"type": ["number", "null"]}
    properties = {"t_s": {"type": "number"}, "chamber_0_pa": number, "chamber_1_pa": number}
    schema = json.dumps({"type": "object", "properties": properties}).encode()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="softarm")
        writer.add_metadata("softarm.recording", {"columns": "[]", "version": "2"})
        channel = writer.register_channel(
            "pressures", "json", writer.register_schema("softarm.pressures", "jsonschema", schema)
        )
        for tick in range(5):
            message = {"t_s": 0.1 * tick, "chamber_0_pa": None if tick == 2 else 1e4, "chamber_1_pa": 2e4}
            writer.add_message(channel, tick, json.dumps(message).encode(), tick)
        writer.finish()
    columns = load_recording(path).columns
    assert np.isnan(columns["pressure_0_pa"]).tolist() == [False, False, True, False, False]
    assert columns["pressure_1_pa"].tolist() == [2e4] * 5


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """A folder with Foxglove's own packages for reading recordings, from npm's registry."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed: Foxglove's own parser is not tried")
    folder = tmp_path_factory.mktemp("npm")
    for name in ("package.json", "package-lock.json"):
        shutil.copy(PARSER / name, folder)
    options = ["--ignore-scripts", "--no-audit", "--no-fund", "--prefer-offline"]
    done = subprocess.run(
        ["npm", "ci", *options], cwd=folder, capture_output=True, text=True, timeout=100, check=False
    )
    if done.returncode != 0:
        pytest.skip(f"npm cannot install Foxglove's parser: {done.stderr.strip().splitlines()[-1:]}")
    return folder


def test_foxgloves_own_parser_takes_every_channel(path, messages, packages):
    done = subprocess.run(
        ["node", PARSER / "read.mjs", path, packages],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout)
    assert {topic: entry["messages"] for topic, entry in read.items()} == {
        topic: len(rows) for topic, rows in messages.items()
    }
    assert read["/frames"]["fields"] == ["transforms"]
    assert "entities" in read["/scene"]["fields"]

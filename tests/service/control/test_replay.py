"""A recording in place of the instruments: every reading in its order, and nothing that moves."""

import asyncio
import time

import numpy as np
import pytest

from softarm.daemon.config import SensorSettings
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.control.replay import BANK, ReplayedInstruments
from softarm.drivers.errors import InterlockError
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording

SAMPLES, STEP_S, SPEED, CHAMBERS = 6, 0.5, 50.0, 2
SENSORS = (
    SensorSettings(kind="pose", section="tip", device="qtm", channel="tip", needed=True),
    SensorSettings(kind="bend", section="tip", device="bend"),
    SensorSettings(kind="gauge", section="tip", device="gauge"),
    SensorSettings(kind="bend", section="intermediate", device="other"),
)


def recording(**more: np.ndarray) -> Recording:
    pose = {"x_m": 0.0, "y_m": 0.0, "z_m": 0.3, "qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    columns = {f"pressure_{k}_pa": 1e3 * (k + np.arange(SAMPLES)) for k in range(CHAMBERS)}
    for section in ("tip", "base"):
        columns |= {f"frame_{section}_{name}": np.full(SAMPLES, value) for name, value in pose.items()}
    columns |= {f"bend_tip_{axis}_rad": 0.1 * np.arange(SAMPLES) for axis in "xy"}
    columns["gauge_tip_n"] = np.where(np.arange(SAMPLES) == 2, np.nan, 0.5)
    return Recording("run", 7.0 + STEP_S * np.arange(SAMPLES), columns | more, {})


def played(one: Recording) -> tuple[list[ChannelReading], float]:
    """Play a recording; return the readings and how long it took [s]."""
    readings: list[ChannelReading] = []
    ended: list[int] = []
    instruments = ReplayedInstruments(
        one, SENSORS, CHAMBERS, SPEED, readings.append, lambda: ended.append(len(readings))
    )
    began = time.monotonic()
    asyncio.run(instruments.connect())
    assert ended == [len(readings)]  # once, after the last
    return readings, time.monotonic() - began


def test_every_reading_comes_in_its_order_with_the_time_at_which_it_was_taken() -> None:
    readings, lasted_s = played(recording())
    for name, width in ((BANK, CHAMBERS), ("qtm/tip", 7), ("bend", 2), ("base", 7)):
        own = [reading for reading in readings if reading.device == name]
        assert [reading.sequence for reading in own] == list(range(SAMPLES))
        assert [reading.device_time_ns for reading in own] == [
            round((7.0 + STEP_S * k) * 1e9) for k in range(SAMPLES)
        ]
        assert {len(reading.value) for reading in own} == {width}
    assert [reading.value for reading in readings if reading.device == "bend"][3] == pytest.approx((0.3, 0.3))
    assert {reading.source for reading in readings} == {"replay"}
    assert lasted_s >= (SAMPLES - 1) * STEP_S / SPEED


def test_what_was_lost_stays_lost_and_what_was_not_recorded_never_comes() -> None:
    readings, _ = played(recording())
    assert [reading.sequence for reading in readings if reading.device == "gauge"] == [0, 1, 3, 4, 5]
    assert not any(reading.device == "other" for reading in readings)


def test_a_recording_without_all_pressures_plays_its_motion() -> None:
    whole = recording()
    columns = {name: values for name, values in whole.columns.items() if name != "pressure_1_pa"}
    readings, _ = played(Recording("run", whole.time, columns, {}))
    assert {reading.device for reading in readings} == {"qtm/tip", "bend", "gauge", "base"}


def test_a_recording_of_no_configured_sensor_is_refused() -> None:
    pressures = {name: v for name, v in recording().columns.items() if name.startswith("pressure")}
    bare = Recording("run", recording().time, pressures, {})
    with pytest.raises(InputError, match="has none of pose of tip, bend of tip"):
        ReplayedInstruments(bare, SENSORS, CHAMBERS, SPEED, lambda _: None, lambda: None)


def test_a_replay_moves_nothing() -> None:
    instruments = ReplayedInstruments(recording(), SENSORS, CHAMBERS, SPEED, lambda _: None, lambda: None)
    for ask in (instruments.valves.arm, lambda: instruments.valves.command((1e4, 1e4), 1.0)):
        with pytest.raises(InterlockError, match="a recording is being replayed"):
            ask()
    assert not instruments.valves.armed
    assert not instruments.applied.any()
    with pytest.raises(KeyError):
        asyncio.run(instruments.reconnect("qtm"))

"""The judge of the soak: it lets sound readings pass and finds each kind of mislabelling."""

import math

import pytest

from softarm.bench.driver_soak import Judge, Outcome, Soak
from softarm.drivers.gauges.force import Force
from softarm.drivers.qualisys.motion import MotionFrame
from softarm.drivers.qualisys.poses import BodyPose
from softarm.drivers.reading import Reading
from softarm.drivers.valves import BankReading


def reading(index, **changes):
    fields = {
        "device": "gauge",
        "value": Force(1.0, 1.0, 0.01, "N"),
        "device_time_ns": index * 10,
        "host_monotonic_ns": 1000 + index * 10,
        "measured_ns": 995 + index * 10,
        "sequence": index,
        "epoch": 0,
        "valid": True,
        "source": "fake+serial:///dev/gauge",
    }
    return Reading(**{**fields, **changes})


def judged(*readings):
    judge = Judge()
    for one in readings:
        judge.take(one)
    return list(judge.violations)


def test_sound_readings_pass():
    restarted = reading(0, epoch=1, host_monotonic_ns=9000, measured_ns=8000)
    assert judged(reading(0), reading(1), reading(3), restarted) == []


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"source": "serial:///dev/gauge"}, "source does not say fake"),
        ({"measured_ns": 10**9}, "measured after it arrived"),
        ({"host_monotonic_ns": 996}, "arrived before the one before"),
        ({"epoch": -1}, "epoch went back"),
        ({"sequence": 0}, "sequence did not rise"),
        ({"device_time_ns": 0}, "old device time, new reading"),
        ({"value": Force(math.nan, 1.0, 0.01, "N")}, "value that is no number"),
        ({"value": BankReading(None, (0.0,), None, (9e9,), (0,), False)}, "pressure beyond the supply"),
        ({"value": MotionFrame({"tip": BodyPose((0, 0, 0), (1, 1, 0, 0))}, {})}, "pose that is none"),
        ({"value": MotionFrame({"tip": BodyPose((9, 0, 0), (1, 0, 0, 0))}, {})}, "pose that is none"),
    ],
)
def test_each_mislabelling_is_found(changes, told):
    assert told in judged(reading(0), reading(1, **changes))


def test_a_lost_body_is_no_violation():
    assert judged(reading(0, value=MotionFrame({"tip": None}, {"tip": 1.0}))) == []


@pytest.mark.parametrize(
    ("outcome", "leaked", "sound"),
    [
        (Outcome(struck=2, noticed=2), (), True),
        (Outcome(struck=2, noticed=1), (), False),
        (Outcome(struck=2, noticed=2, unrecovered=1), (), False),
        (Outcome(struck=2, noticed=2), ("gauge stream",), False),
    ],
)
def test_what_makes_a_run_sound(outcome, leaked, sound):
    assert Soak({"gauge": {"unplug": outcome}}, {"gauge": Judge()}, {}, leaked, (), 0, 1.0).sound is sound
    unseen = Soak({"gauge": {"offset": Outcome(struck=3)}}, {"gauge": Judge()}, {}, (), (), 0, 1.0)
    assert unseen.sound

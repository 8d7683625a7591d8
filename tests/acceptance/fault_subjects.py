"""Every kind of device under random faults: its fake, its driver, and what the truth of a reading is."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats

Moment = tuple[float, Any, Floats]
"""Time [s], snapshot of the arm and pressures at the outlets in chamber order [Pa]."""

CHAMBERS = [3, 2, 1, 0, 4, 5]
SECTIONS = ("base", "intermediate", "tip")
NO_CHECKSUM = {"bit_flip", "byte_loss", "parity"}
WEAK_SUM = {"stall", "bit_flip"}
"""A sum of eight bits lets one damaged frame in 256 pass."""

REFILLING = {"supply_missing", "stuck_valve", "valve_fault"}
"""After these the outlet sensors show the pulses of a valve that refills a chamber."""


@dataclass(frozen=True)
class Subject:
    """One device.

    Args:
        name: Its name.
        fake: Its table in the scenario.
        driver: Its table in the configuration, without the address.
        error: Distance of a value from the truth of one moment, over what it may be: at most 1 is right.
        window: How long before its time a value may have been true [s].
        quiet: Faults that a driver need not notice.
        blind: Faults under which a wrong value, or a late one on a line without time stamps, cannot be told
            from a right one.
        left_out: Faults whose consequence lasts for ever, so that no value after them can be checked.
        parameters: Parameters of faults whose words are not to be drawn from their limits.
    """

    name: str
    fake: Mapping[str, Any]
    driver: Mapping[str, Any]
    error: Callable[[Any, Moment], float]
    window: float
    quiet: set[str] = field(default_factory=set)
    blind: set[str] = field(default_factory=set)
    left_out: set[str] = field(default_factory=set)
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def _bank(value: Any, moment: Moment) -> float:
    return float(np.abs(np.array(value.readback) - moment[2]).max() / 3.0e3)


def _frame(value: Any, moment: Moment) -> float:
    positions = moment[1].positions
    errors = [
        math.dist(pose.position, positions[SECTIONS.index(name)])
        for name, pose in value.poses.items()
        if pose is not None
    ]
    return max(errors, default=0.0) / 1.0e-3


def _force(value: Any, moment: Moment) -> float:
    return float(abs(value.force - moment[1].cord_force) / 0.15)


def _bend(value: Any, moment: Moment) -> float:
    pairs = zip((1, 2), (0, 1), strict=True)
    errors = [
        np.abs(np.array(value.angles[sensor]) - moment[1].bends[segment]).max()
        for sensor, segment in pairs
        if value.valid[sensor]
    ]
    return float(max(errors, default=0.0) / math.radians(1.2))


def _attitude(section: int, tolerance: float) -> Callable[[Any, Moment], float]:
    """Compare the direction of the third axis, which does not depend on the heading."""

    def error(value: Any, moment: Moment) -> float:
        seen, true = _down(value.quaternion), _down(moment[1].quaternions[section])
        return float(np.linalg.norm(seen - true) / tolerance)

    return error


def _down(quaternion: Sequence[float]) -> Floats:
    w, x, y, z = quaternion
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def _gauge(name: str, fake: Mapping[str, Any], driver: Mapping[str, Any], **sets: Any) -> Subject:
    blind = NO_CHECKSUM | {"offset", "inverted", "stall", *sets.get("blind", ())}
    quiet = {"offset", "stall", "lower_display", "garbage", *sets.get("quiet", ())}
    return Subject(
        name,
        {"kind": name, **fake},
        {"kind": name, **driver},
        _force,
        0.25,
        quiet | NO_CHECKSUM,
        blind,
        {"operator_zero", *sets.get("left_out", ())},
        {"malformed": {"kind": "nan"}, "unit": {}},
    )


SUBJECTS = (
    Subject(
        "valves",
        {"kind": "festo_mpa", "valve_map": CHAMBERS},
        {"kind": "festo_mpa", "chambers": CHAMBERS, "maximum_pa": 60e3, "slew_pa_per_s": 15e3},
        _bank,
        0.12,
        quiet={"split_reply", "delay", "no_watchdog", "refuse", "reading_offset", "stuck_valve"},
        blind={"reading_offset", *REFILLING},
        parameters={
            "valve_fault": {"channel": 4},
            "second_master": {"channel": 9, "mbar": 120},
            "exception": {"code": 6},
            "delay": {"delay_s": 0.02},
            "late_reply": {"delay_s": 0.15},
        },
    ),
    Subject(
        "qtm",
        {"kind": "qualisys"},
        {"kind": "qualisys"},
        _frame,
        0.03,
        quiet={"split", "coalesce", "full", "udp_loss", "latency", "drop_rate"},
        blind={"latency"},
        parameters={"latency": {"seconds": 0.1}, "frame_gap": {"frames": 20}},
    ),
    _gauge("lutron", {}, {}),
    _gauge("mark10", {}, {}, quiet=["refuses", "no_unit", "inverted"]),
    _gauge("sauter", {}, {"unit": "N"}, blind=["unit"], quiet=["unit", "deaf", "torn_frame", "over_range"]),
    _gauge("line_gauge", {}, {}, quiet=["torn_frame"], blind=["torn_frame"]),
    Subject(
        "bendlabs",
        {"kind": "bendlabs", "boot_s": 0.8},
        {"kind": "bendlabs"},
        _bend,
        0.30,
        quiet={"dropout", "stall", "torn_frame"} | NO_CHECKSUM,
        blind={"dropout", "cannot_connect", "stall"} | NO_CHECKSUM,
        parameters={"malformed": {"kind": "seven"}},
    ),
    Subject(
        "bno08x_rvc",
        {"kind": "bno08x_rvc"},
        {"kind": "bno08x_rvc"},
        _attitude(2, 0.05),
        0.05,
        quiet={"stall", "false_header", "wrong_rate", "garbage"},
        blind=WEAK_SUM,
        parameters={"index_gap": {"frames": 20}},
    ),
    Subject(
        "witmotion",
        {"kind": "witmotion", "baud": 115200},
        {"kind": "witmotion", "rate_hz": 50},
        _attitude(2, 0.05),
        0.06,
        quiet={"stall", "locked", "garbage", "torn_frame"},
        blind=WEAK_SUM,
    ),
    Subject(
        "xbus",
        {"kind": "xbus"},
        {"kind": "xbus"},
        _attitude(2, 0.05),
        0.05,
        quiet={"stall", "garbage"},
        blind=WEAK_SUM,
        parameters={"index_gap": {"frames": 20}},
    ),
    Subject(
        "quaternion_line",
        {"kind": "quaternion_line"},
        {"kind": "quaternion_line", "unit": 2, "rate_hz": 8},
        _attitude(2, 0.10),
        0.25,
        quiet={"stall", "garbage", "torn_frame"} | NO_CHECKSUM,
        blind={"stall"} | NO_CHECKSUM,
        parameters={"malformed": {"kind": "three"}},
    ),
)

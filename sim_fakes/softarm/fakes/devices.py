"""From the tables of a scenario to fakes: each with its board of faults."""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.errors import InputError
from softarm.fakes.faults import Fault, FaultBoard, nearest
from softarm.fakes.parts import (
    BendPart,
    BnoPart,
    DevicePart,
    GaugePart,
    InertialPart,
    LineGaugePart,
    LutronPart,
    Mark10Part,
    QtmPart,
    QuaternionLinePart,
    SauterPart,
    SerialPart,
    ValvesPart,
    WitMotionPart,
    XbusPart,
)
from softarm.fakes.plant.state import Plant
from softarm.fakes.qtm.measurement import MotionMeasurement, measurement_faults
from softarm.fakes.qtm.server import SERVER_FAULTS
from softarm.fakes.serial.bend import BendBoard, bend_faults
from softarm.fakes.serial.bno import BNO_FAULTS, BnoRvc
from softarm.fakes.serial.instrument import Instrument
from softarm.fakes.serial.line_gauge import LINE_GAUGE_FAULTS, LineGauge
from softarm.fakes.serial.load_cell import LoadCell
from softarm.fakes.serial.lutron import LUTRON_FAULTS, LutronGauge
from softarm.fakes.serial.mark10 import MARK10_FAULTS, FakeMark10
from softarm.fakes.serial.quaternion_line import QUATERNION_LINE_FAULTS, QuaternionLine
from softarm.fakes.serial.sauter import SAUTER_FAULTS, FakeSauter
from softarm.fakes.serial.witmotion import WITMOTION_FAULTS, WitMotion
from softarm.fakes.serial.xbus import XBUS_FAULTS, XbusModule
from softarm.fakes.signals import SignalFilter, by_valve, unmodified
from softarm.fakes.valves.mpa import MpaBank, bank_faults
from softarm.fakes.valves.node import CpxNode, node_faults
from softarm.fakes.valves.pneumatics import MBAR, Regulators
from softarm.fakes.valves.server import WIRE_FAULTS
from softarm.fakes.valves.vtem import LOWEST_MBAR, VtemBank, vtem_faults

VALVES = 16

INSTRUMENTS: Mapping[type[SerialPart], tuple[Callable[..., Instrument], tuple[Fault, ...]]] = {
    LutronPart: (LutronGauge, LUTRON_FAULTS),
    Mark10Part: (FakeMark10, MARK10_FAULTS),
    SauterPart: (FakeSauter, SAUTER_FAULTS),
    LineGaugePart: (LineGauge, LINE_GAUGE_FAULTS),
    BnoPart: (BnoRvc, BNO_FAULTS),
    WitMotionPart: (WitMotion, WITMOTION_FAULTS),
    XbusPart: (XbusModule, XBUS_FAULTS),
    QuaternionLinePart: (QuaternionLine, QUATERNION_LINE_FAULTS),
}
"""Gauges and inertial units: what is built, and its faults."""


@dataclass(frozen=True)
class DeviceSurroundings:
    """What devices are built into.

    Args:
        plant: The arm.
        seed: Seed of the scenario.
        signal_filter: What is concealed in signals.
        misalignments: Rotation vector of the motion-capture body of each named section [rad].
    """

    plant: Plant
    seed: int
    signal_filter: SignalFilter = unmodified
    misalignments: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


def seed_of(seed: int, name: str) -> int:
    """Return a device its own seed, whatever other devices there are."""
    # Not `hash`, which Python salts anew in every process.
    return zlib.crc32(f"{seed}/{name}".encode())


def catalogue(part: DevicePart) -> tuple[Fault, ...]:
    """List the faults of a device."""
    if isinstance(part, ValvesPart):
        bank = bank_faults(VALVES) if part.kind == "festo_mpa" else vtem_faults()
        return (*WIRE_FAULTS, *node_faults(VALVES), *bank)
    if isinstance(part, QtmPart):
        return (*SERVER_FAULTS, *measurement_faults([body.name for body in part.bodies]))
    if isinstance(part, BendPart):
        return bend_faults(len(part.sensors))
    assert isinstance(part, SerialPart)
    return INSTRUMENTS[type(part)][1]


def build_node(part: ValvesPart, around: DeviceSurroundings, faults: FaultBoard) -> CpxNode:
    """Build a terminal.

    Raises:
        InputError: Its valve map does not fit the arm.
    """
    if len(part.valve_map) != around.plant.chambers:
        what = f"valve_map has {len(part.valve_map)} entries, the arm has {around.plant.chambers} chambers"
        raise InputError(f"scenario, device {part.name}", what, "give one valve per chamber")
    mpa = part.kind == "festo_mpa"
    figures = Regulators(
        dead_time=part.dead_time_s,
        fill_time=part.fill_time_s,
        bias=part.bias_pa,
        noise=part.noise_pa,
        supply=part.supply_pa,
        lowest=0.0 if mpa else LOWEST_MBAR * MBAR,
    )
    seed, signal_filter = seed_of(around.seed, part.name), by_valve(around.signal_filter, part.valve_map)
    bank = (
        MpaBank(faults, VALVES, figures, seed, signal_filter)
        if mpa
        else VtemBank(faults, figures, seed, signal_filter)
    )
    return CpxNode(bank, faults, part.watchdog_ms)


def build_measurement(part: QtmPart, around: DeviceSurroundings, faults: FaultBoard) -> MotionMeasurement:
    """Build the measurement of a motion capture.

    Raises:
        InputError: A body names a section that the arm does not have.
    """
    sections = around.plant.sections
    for body in part.bodies:
        _index(part, body.section, sections)
    seed = seed_of(around.seed, part.name)
    return MotionMeasurement(part, sections, around.misalignments, faults, seed, around.signal_filter)


def build_instrument(part: SerialPart, around: DeviceSurroundings, faults: FaultBoard) -> Instrument:
    """Build a serial instrument.

    Raises:
        InputError: It names a section or segment that the arm does not have.
    """
    seed, plant = seed_of(around.seed, part.name), around.plant
    if isinstance(part, BendPart):
        for name in filter(None, part.sensors):
            _index(part, name, plant.segments)
        return BendBoard(part, faults, plant, seed, around.signal_filter)
    make, _ = INSTRUMENTS[type(part)]
    if isinstance(part, GaugePart):
        return make(part, faults, LoadCell(part, faults, seed, around.signal_filter))
    if isinstance(part, QuaternionLinePart):
        return make(part, faults, [_index(part, name, plant.sections) for name in part.sections], seed)
    assert isinstance(part, InertialPart)
    return make(part, faults, _index(part, part.section, plant.sections), seed)


def _index(part: DevicePart, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise InputError(f"scenario, device {part.name}", f"the arm has no {name!r}", nearest(name, names))
    return list(names).index(name)

"""Every fault of every device in every mode, one at a time: is the arm left where it must be?"""

import asyncio
import logging
import tempfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acceptance.safety_arm import SafetyArm, safety_arm
from acceptance.safety_cases import PLAYING, SILENT_FAULTS, SLOW_S, STRIKE, Expectation, expected
from acceptance.warp import WarpLoop
from softarm.daemon.safety.modes import PRESSURISED, Mode

MODES = (Mode.ARMED, Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT)
"""Modes in which the chambers hold pressure; in the others it is vented whatever strikes."""
BENCHES: tuple[Mapping[str, str], ...] = (
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "lutron", "bend": "bendlabs", "imu": "xbus"},
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "mark10", "imu": "bno08x_rvc"},
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "sauter", "imu": "witmotion"},
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "line_gauge", "imu": "quaternion_line"},
    {"valves": "festo_vtem", "qtm": "qualisys"},
)
"""The kinds of the devices by name; one is a valve terminal."""
KINDS = tuple(dict.fromkeys(kind for kinds in BENCHES for kind in kinds.values()))

LASTS_S = 0.6
LOOK_S = 0.004
KEPT_S = 3.0
"""An error that still stands after so long is kept; slots that were lost regulate again in two seconds."""


@dataclass(frozen=True)
class Case:
    """One fault in one mode.

    Args:
        kind: Kind of the device.
        fault: Name of the fault.
        mode: Mode in which it struck.
        wanted: Where it must leave the arm.
        within_s: How soon the terminal must hold zeros.
        outcome: Where it left the arm.
        vented_s: When the terminal held zeros [s], ``None`` when it never did.
        stayed: Whether the arm stayed as the fault had left it until somebody cleared it.
        recovered: Whether every device was well again after the fault.
        said: Why the mode ended, in the service's words.
    """

    kind: str
    fault: str
    mode: Mode
    wanted: Expectation
    within_s: float
    outcome: Expectation
    vented_s: float | None
    stayed: bool
    recovered: bool
    said: str

    @property
    def right(self) -> bool:
        """Whether all is as stated."""
        in_time = self.outcome is Expectation.CARRIES_ON or (
            self.vented_s is not None and self.vented_s <= self.within_s
        )
        fits = self.wanted in (self.outcome, Expectation.EITHER)
        return fits and in_time and self.stayed and self.recovered


@dataclass(frozen=True)
class Part:
    """What one process strikes: a bench in one mode.

    Args:
        kinds: Kinds of the bench's devices by name.
        struck: Those that are struck.
        mode: The mode.
    """

    kinds: Mapping[str, str]
    struck: Mapping[str, str]
    mode: Mode


Choose = Callable[[str, str, Mode], bool]


def parts(
    benches: Sequence[Mapping[str, str]] = BENCHES,
    modes: Sequence[Mode] = MODES,
    wanted: Sequence[str] = KINDS,
) -> list[Part]:
    """List each bench in each mode; a wanted kind of device is struck on the first bench that has it."""
    known: set[str] = set()
    found = []
    for kinds in benches:
        struck = {name: kind for name, kind in kinds.items() if kind in wanted and kind not in known}
        known |= set(kinds.values())
        found += [Part(kinds, struck, mode) for mode in modes if struck]
    return found


def run(part: Part, choose: Choose, speed: float = 40.0) -> list[Case]:
    """Strike each device of a part with each of its faults.

    Args:
        part: Bench, devices and mode.
        choose: Tells whether to try a fault of a kind in a mode.
        speed: Virtual seconds per second of waiting.
    """
    logging.disable(logging.WARNING)
    try:
        with asyncio.Runner(loop_factory=lambda: WarpLoop(speed)) as runner:
            return runner.run(_strike_all(part, choose))
    finally:
        logging.disable(logging.NOTSET)


async def _strike_all(part: Part, choose: Choose) -> list[Case]:
    with tempfile.TemporaryDirectory(prefix="softarm-safety-") as folder:
        async with safety_arm(part.kinds, Path(folder)) as arm:
            await arm.until_well()
            chosen = [
                (name, kind, fault)
                for name, kind in part.struck.items()
                for fault in arm.rig.boards[name].catalogue.values()
                if choose(kind, fault.name, part.mode)
            ]
            return [await _strike(arm, name, kind, fault, part.mode) for name, kind, fault in chosen]


async def _strike(arm: SafetyArm, name: str, kind: str, fault: Any, mode: Mode) -> Case:
    slow = (kind, fault.name) in SILENT_FAULTS and mode in PLAYING
    await arm.enter(mode)
    arm.gaps.begin()
    if slow:
        arm.chamber_pa *= 2.0  # what is stuck shows only in a pressure that should change
    board = arm.rig.boards[name]
    board.set(fault.name, STRIKE.get(fault.name))
    vented_s = await _watch(arm, SLOW_S + 0.3 if slow else LASTS_S)
    wanted, within_s = expected(kind, fault.name, mode, arm.gaps.longest_s, arm.deadline_s)
    outcome = Expectation.VENTS if arm.mode is not mode else Expectation.CARRIES_ON
    said = arm.loop.controller.modes.fault_cause or ""
    left = arm.mode
    board.clear(fault.name)
    kept = await _is_kept(arm)
    recovered = kept or await arm.until_well()
    if slow:
        arm.chamber_pa /= 2.0
    vented = not any(arm.setpoints)
    stayed = arm.mode is left and vented is (left not in PRESSURISED)
    if kept:
        await arm.acknowledge()
        recovered = await arm.until_well()
    return Case(kind, fault.name, mode, wanted, within_s, outcome, vented_s, stayed, recovered, said)


async def _is_kept(arm: SafetyArm) -> bool:
    """Return whether the valves keep an error that nobody has acknowledged, however long one waits."""
    await asyncio.sleep(KEPT_S if arm.error_kept else 0.0)
    return arm.error_kept


async def _watch(arm: SafetyArm, seconds: float) -> float | None:
    """Wait, and tell when the terminal first held zeros [s]."""
    loop = asyncio.get_running_loop()
    began, vented_s = loop.time(), None
    while loop.time() < began + seconds:
        if vented_s is None and not any(arm.setpoints):
            vented_s = loop.time() - began
        await asyncio.sleep(LOOK_S)
    return vented_s


def quick(kind: str, fault: str, mode: Mode) -> bool:
    """Choose each fault of valves and motion capture once, of the others one in three, the modes in turn."""
    turn = zlib.crc32(f"{kind} {fault}".encode())
    vital = kind.startswith("festo") or kind == "qualisys"
    pressurised = [Mode.ARMED, Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT]
    return mode is pressurised[turn % 4] and (vital or turn % 3 == 0)


def everything(kind: str, fault: str, mode: Mode) -> bool:  # noqa: ARG001
    """Choose every case."""
    return True

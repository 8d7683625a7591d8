"""Every fault of every device in every mode, one at a time: is the arm left where it must be?"""

import asyncio
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.bench.safety_arm import SafetyArm, safety_arm
from service.bench.safety_cases import SLOW_S, STRIKE, Outcome, expected
from service.cli import fakes
from service.safety.modes import PRESSURISED, Mode

MODES = (
    Mode.STARTING,
    Mode.IDLE,
    Mode.ARMED,
    Mode.TEACH,
    Mode.HOLDING,
    Mode.EXPERIMENT,
    Mode.FAULTED,
    Mode.STOPPING,
)
"""In the order in which one arm can be led through all of them."""
BENCHES: tuple[Mapping[str, str], ...] = (
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "lutron", "bend": "bendlabs", "imu": "xbus"},
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "mark10", "imu": "bno08x_rvc"},
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "sauter", "imu": "witmotion"},
    {"valves": "festo_mpa", "qtm": "qualisys", "gauge": "line_gauge", "imu": "quaternion_line"},
    {"valves": "festo_vtem", "qtm": "qualisys"},
)
"""The kinds of the devices by name; one is a valve terminal. Each kind is struck on the first that has it."""

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
    wanted: Outcome
    within_s: float
    outcome: Outcome
    vented_s: float | None
    stayed: bool
    recovered: bool
    said: str

    @property
    def right(self) -> bool:
        """Whether all is as stated."""
        in_time = self.wanted is Outcome.CARRIES_ON or (
            self.vented_s is not None and self.vented_s <= self.within_s
        )
        return self.outcome is self.wanted and in_time and self.stayed and self.recovered


def run(
    benches: Sequence[Mapping[str, str]],
    choose: Callable[[str, str, Mode], bool],
    advance: Callable[[], None],
    speed: float = 40.0,
) -> list[Case]:
    """Strike each device of each bench with each of its faults in each mode.

    Args:
        benches: Kinds of the devices by name.
        choose: Tells whether to try a fault of a kind in a mode.
        advance: Called after each case.
        speed: Virtual seconds per second of waiting.
    """
    cases = []
    for kinds, struck in _struck(benches):
        with asyncio.Runner(loop_factory=lambda: fakes.accelerated(speed)) as runner:
            cases += runner.run(_bench(kinds, struck, choose, advance))
    return cases


def count(benches: Sequence[Mapping[str, str]], choose: Callable[[str, str, Mode], bool]) -> int:
    """Count the cases of a run without running it."""
    with asyncio.Runner() as runner:
        return sum(runner.run(_count(kinds, struck, choose)) for kinds, struck in _struck(benches))


def _struck(
    benches: Sequence[Mapping[str, str]],
) -> Iterator[tuple[Mapping[str, str], Mapping[str, str]]]:
    """Give each bench with those of its devices whose kind none before it has."""
    known: set[str] = set()
    for kinds in benches:
        yield kinds, {name: kind for name, kind in kinds.items() if kind not in known}
        known |= set(kinds.values())


async def _count(
    kinds: Mapping[str, str], struck: Mapping[str, str], choose: Callable[[str, str, Mode], bool]
) -> int:
    with tempfile.TemporaryDirectory(prefix="softarm-safety-") as folder:
        async with safety_arm(kinds, Path(folder)) as arm:
            return sum(1 for _ in _plan(arm, struck, choose))


def _plan(
    arm: SafetyArm, struck: Mapping[str, str], choose: Callable[[str, str, Mode], bool]
) -> Iterator[tuple[str, Any, Mode]]:
    for mode in MODES:
        for name, kind in struck.items():
            for fault in arm.rig.boards[name].catalogue.values():
                if choose(kind, fault.name, mode):
                    yield name, fault, mode


async def _bench(
    kinds: Mapping[str, str],
    struck: Mapping[str, str],
    choose: Callable[[str, str, Mode], bool],
    advance: Callable[[], None],
) -> list[Case]:
    cases = []
    with tempfile.TemporaryDirectory(prefix="softarm-safety-") as folder:
        async with safety_arm(kinds, Path(folder)) as arm:
            await arm.until_well()
            for name, fault, mode in _plan(arm, struck, choose):
                cases.append(await _strike(arm, name, kinds[name], fault, mode))
                advance()
    return cases


async def _strike(arm: SafetyArm, name: str, kind: str, fault: Any, mode: Mode) -> Case:
    slow = expected(kind, fault.name, mode, blind=False)[1] == SLOW_S
    await arm.enter(mode)
    arm.blind = False
    if slow:
        arm.chamber_pa *= 2.0  # what is stuck shows only in a pressure that should change
    board = arm.rig.boards[name]
    board.set(fault.name, STRIKE.get(fault.name))
    vented_s = await _watch(arm, SLOW_S + 0.3 if slow else LASTS_S)
    wanted, within_s = expected(kind, fault.name, mode, arm.blind)
    outcome = Outcome.VENTS if arm.mode is not mode else Outcome.CARRIES_ON
    said = arm.controller.modes.fault_cause or ""
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
    """Tell whether the valves keep an error that nobody has acknowledged, however long one waits."""
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

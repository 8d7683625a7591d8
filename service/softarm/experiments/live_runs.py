"""What each experiment does live: pressures through the service, cord and hand through the operator."""

from dataclasses import dataclass

import numpy as np

from softarm.common.errors import WorkFailedError
from softarm.estimator.arrays import Floats
from softarm.estimator.recording import Recording
from softarm.experiments.live import LiveRig

CORD_M = 0.30
HIGHEST_PA = 45e3
DRAWN_M = 0.03
"""How far the hand draws the arm out at most: pressures bend no arm without lengthening it."""


@dataclass(frozen=True)
class TaughtLive:
    """Poses shown and held.

    Args:
        recording: What was recorded meanwhile.
        shown: Ends of the looks at the shown poses [s].
        held: Ends of the looks at the held ones [s].
        reachable: Whether the service took each pose for reachable.
    """

    recording: Recording
    shown: tuple[float, ...]
    held: tuple[float, ...]
    reachable: tuple[bool, ...]


def random_levels(rng: np.random.Generator, count: int, highest: float = HIGHEST_PA) -> Floats:
    """Draw pressures on two of three chambers per segment [Pa], shape (count, 6)."""
    levels = rng.uniform(0.0, highest, (count, 6))
    for row in levels:
        row[[rng.integers(3), 3 + rng.integers(3)]] = 0.0
    return levels


def validate_live(bench: LiveRig, seed: int, poses: int = 12) -> Recording:
    """Go to random poses and hold each."""
    levels = random_levels(np.random.default_rng(seed), poses)
    with bench.recording("validate") as paths:
        bench.arm()
        for level in levels:
            bench.go(level, ramp_s=1.0, hold_s=3.0)
            bench.advance()
        bench.disarm()
    return bench.load(paths[0])


def calibrate_live(bench: LiveRig, seed: int, poses: int = 8) -> tuple[Recording, Recording, Recording]:
    """Fill each chamber alone, go to random poses; pull in three directions, vented and under pressure."""
    with bench.recording("calibrate") as paths:
        bench.arm()
        for chamber in range(6):
            bench.go(HIGHEST_PA * np.eye(6)[chamber], ramp_s=4.0, hold_s=1.0)
            bench.go(np.zeros(6), ramp_s=2.0, hold_s=1.0)
            bench.advance()
        for level in random_levels(np.random.default_rng(seed), poses):
            bench.go(level, ramp_s=1.0, hold_s=2.5)
            bench.advance()
        bench.disarm()
    moved = bench.load(paths[0])
    with bench.recording("pulls") as paths:
        bench.wait(2.0)
        pull_steps(bench, "tip", turns=(0.0, 2.0, 4.0), steps=8, travel=0.05, rest_s=2.0)
    pulled = bench.load(paths[0])
    with bench.recording("pulls_pressurised") as paths:
        bench.wait(2.0)
        for chamber in range(3):
            against_the_cord(bench, chamber, levels=4, ramp_s=1.0, hold_s=2.0)
    return moved, pulled, bench.load(paths[0])


def pull_steps(
    bench: LiveRig, section: str, turns: tuple[float, ...], steps: int, travel: float, rest_s: float
) -> None:
    """Move the gauge away in small steps from where the cord is just taut.

    Args:
        bench: The running arm.
        section: Section that the cord is tied to.
        turns: Directions about the base frame's z [rad].
        steps: Steps in each direction.
        travel: How far the gauge goes [m].
        rest_s: Wait after each step.
    """
    rest = bench.position(section)  # once: after a strong pull the arm takes a while to come back to it
    for turn in turns:
        way = np.array([np.cos(turn), np.sin(turn), 0.0])
        for distance in np.linspace(0.0, travel, steps):
            bench.tie(section, rest + (CORD_M + distance) * way, CORD_M)
            bench.wait(rest_s)
            bench.advance()
        bench.untie()
        bench.wait(1.5)


def against_the_cord(bench: LiveRig, chamber: int, levels: int, ramp_s: float, hold_s: float) -> None:
    """Tie the tip on a chamber's side, fill that chamber in steps, which bends the arm away, and vent it.

    Args:
        bench: The running arm.
        chamber: Of the first segment; the one below it is filled likewise.
        levels: Number of steps.
        ramp_s: How long each takes; venting takes as long.
        hold_s: How long each is held.
    """
    turn = 2.0 * np.pi * chamber / 3.0
    way = np.array([np.cos(turn), np.sin(turn), 0.0])
    bench.tie("tip", bench.position("tip") + (CORD_M - 2e-3) * way, CORD_M)
    bench.arm()
    level = np.zeros(6)
    level[[chamber, 3 + chamber]] = HIGHEST_PA
    for share in np.linspace(0.0, 1.0, levels + 1)[1:]:
        bench.go(share * level, ramp_s, hold_s)
    bench.go(np.zeros(6), ramp_s, hold_s=1.0)
    bench.disarm()
    bench.untie()
    bench.wait(1.5)
    bench.advance()


def force_live(bench: LiveRig, steps: int = 10) -> tuple[Recording, Recording]:
    """Pull the vented arm in small steps; then ramp pressures against the cord."""
    with bench.recording("force_not_pressurised") as paths:
        bench.wait(2.0)
        pull_steps(bench, "tip", turns=(0.4, 2.5), steps=steps, travel=0.07, rest_s=1.5)
    still = bench.load(paths[0])
    with bench.recording("force_pressurised") as paths:
        bench.wait(2.0)
        for chamber in range(2):
            against_the_cord(bench, chamber, levels=1, ramp_s=8.0, hold_s=0.5)
    return still, bench.load(paths[0])


def teach_live(bench: LiveRig, seed: int, poses: int = 15, reach: float = 0.05) -> TaughtLive:
    """Show poses by hand, let the service hold each, and look."""
    rng = np.random.default_rng(seed)
    shown, held, reachable = [], [], []
    with bench.recording("teach") as paths:
        bench.wait(0.5)
        rest = bench.position("tip")
        for _ in range(poses):
            goal = rest + rng.uniform((-reach, -reach, 0.0), (reach, reach, DRAWN_M))
            begin, end, can = _show_and_hold(bench, rest, goal)
            shown.append(begin)
            held.append(end)
            reachable.append(can)
            bench.advance()
    return TaughtLive(bench.load(paths[0]), tuple(shown), tuple(held), tuple(reachable))


def _show_and_hold(bench: LiveRig, rest: Floats, goal: Floats) -> tuple[float, float, bool]:
    """Show one pose, let the service hold it, and let go.

    Returns:
        Ends of the looks at the shown and the held pose [s], and whether it was told reachable.

    Raises:
        WorkFailedError: The hold ended by itself.
    """
    bench.arm()
    bench.client.teach.start()
    for share in np.linspace(0.25, 1.0, 4):
        bench.operator.lead("tip", rest + share * (goal - rest))
        bench.wait(0.3)
    bench.wait(2.0)
    shown = bench.now
    hold = bench.client.teach.hold(ramp_s=1.5)
    bench.wait(1.8)
    bench.operator.let_go()
    bench.wait(4.0)
    held, mode = bench.now, bench.client.state().mode
    if mode != "HOLDING":
        raise WorkFailedError(f"the hold ended by itself ({mode}); see the service's log")
    bench.disarm()
    bench.wait(1.5)
    return shown, held, hold.reachable

"""What each experiment does live: pressures through the service, cord and hand through the operator."""

from dataclasses import replace

import numpy as np

from softarm.common.errors import WorkFailedError
from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen
from softarm.experiments.live import LiveRig
from softarm_client.results import Hold

CORD_M = 0.30
HIGHEST_PA = 45e3
"""Up to which chambers are filled, where their own limit allows it."""
DRAWN_M = 0.03
"""How far the hand draws the arm out at most: pressures bend no arm without lengthening it."""
TAUGHT, REACH_M = 15, 0.05
"""Poses that the hand shows, and how far to the sides."""


def highest_pressures(specimen: Specimen) -> Floats:
    """Return up to which pressure each chamber is filled [Pa], shape (chambers,)."""
    return np.minimum(HIGHEST_PA, specimen.pressure_limits)


def random_levels(rng: np.random.Generator, specimen: Specimen, count: int) -> Floats:
    """Draw pressures on all chambers but one of each segment [Pa], shape (count, chambers)."""
    levels = rng.uniform(0.0, highest_pressures(specimen), (count, len(specimen.chambers)))
    segments = [np.flatnonzero(flags) for flags in _by_segment(specimen) if flags.any()]
    for row in levels:
        row[[chambers[rng.integers(len(chambers))] for chambers in segments]] = 0.0
    return levels


def one_side(specimen: Specimen, azimuth: float) -> Floats:
    """Return the pressures that fill each segment's chamber nearest to an azimuth [Pa], shape (chambers,)."""
    away = np.array([1.0 - np.cos(chamber.azimuth_rad - azimuth) for chamber in specimen.chambers])
    filled = np.zeros(len(away))
    for flags in _by_segment(specimen):
        if flags.any():
            filled[np.argmin(np.where(flags, away, np.inf))] = 1.0
    return filled * highest_pressures(specimen)


def _by_segment(specimen: Specimen) -> list[Flags]:
    names = np.array([chamber.segment for chamber in specimen.chambers])
    return [names == segment.name for segment in specimen.segments]


def first_azimuths(specimen: Specimen, count: int) -> list[float]:
    """List the azimuths of the first segment's first chambers [rad], ``count`` of them at most."""
    first = specimen.chambers[0].segment
    return [chamber.azimuth_rad for chamber in specimen.chambers if chamber.segment == first][:count]


def validate_live(rig: LiveRig, seed: int) -> tuple[Recording, ...]:
    """Go to random poses and hold each."""
    levels = random_levels(np.random.default_rng(seed), rig.specimen, 12)
    with rig.recording("validate") as paths:
        rig.arm()
        for level in levels:
            rig.go(level, ramp_s=1.0, hold_s=3.0)
            rig.advance()
        rig.disarm()
    return (rig.load(paths[0]),)


def calibrate_live(rig: LiveRig, seed: int, poses: int = 8) -> tuple[Recording, Recording, Recording]:
    """Fill each chamber alone, go to random poses; pull in three directions, vented and under pressure."""
    with rig.recording("calibrate") as paths:
        rig.arm()
        for filled in np.diag(highest_pressures(rig.specimen)):
            rig.go(filled, ramp_s=4.0, hold_s=1.0)
            rig.go(np.zeros_like(filled), ramp_s=2.0, hold_s=1.0)
            rig.advance()
        for level in random_levels(np.random.default_rng(seed), rig.specimen, poses):
            rig.go(level, ramp_s=1.0, hold_s=2.5)
            rig.advance()
        rig.disarm()
    moved = rig.load(paths[0])
    with rig.recording("pulls") as paths:
        rig.wait(2.0)
        pull_steps(rig, "tip", azimuths=(0.0, 2.0, 4.0), steps=8, travel=0.05, rest_s=2.0)
    pulled = rig.load(paths[0])
    with rig.recording("pulls_pressurised") as paths:
        rig.wait(2.0)
        for azimuth in first_azimuths(rig.specimen, 3):
            against_the_cord(rig, azimuth, np.linspace(0.25, 1.0, 4), ramp_s=1.0, hold_s=2.0)
    return moved, pulled, rig.load(paths[0])


def pull_steps(
    rig: LiveRig, section: str, azimuths: tuple[float, ...], steps: int, travel: float, rest_s: float
) -> None:
    """Move the gauge away in small steps from where the cord is just taut.

    Args:
        rig: The running arm.
        section: Section that the cord is tied to.
        azimuths: Directions about the base frame's z [rad].
        steps: Steps in each direction.
        travel: How far the gauge goes [m].
        rest_s: Wait after each step.
    """
    rest = rig.position(section)  # once: after a strong pull the arm takes a while to come back to it
    for azimuth in azimuths:
        way = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        for distance in np.linspace(0.0, travel, steps):
            rig.tie(section, rest + (CORD_M + distance) * way, CORD_M)
            rig.wait(rest_s)
            rig.advance()
        rig.untie()
        rig.wait(1.5)


def against_the_cord(rig: LiveRig, azimuth: float, levels: Floats, ramp_s: float, hold_s: float) -> None:
    """Tie the tip on one side, fill the chambers there in steps, which bends the arm away, and vent them.

    Args:
        rig: The running arm.
        azimuth: Of the side [rad].
        levels: Shares of the highest pressures, one per step, shape (steps,).
        ramp_s: How long each takes; venting takes as long.
        hold_s: How long each is held.
    """
    way = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    rig.tie("tip", rig.position("tip") + (CORD_M - 2e-3) * way, CORD_M)
    rig.arm()
    highest = one_side(rig.specimen, azimuth)
    for level in levels:
        rig.go(level * highest, ramp_s, hold_s)
        rig.advance()
    rig.go(np.zeros_like(highest), ramp_s, hold_s=1.0)
    rig.disarm()
    rig.untie()
    rig.wait(1.5)


def force_live(rig: LiveRig) -> tuple[Recording, Recording]:
    """Pull the vented arm in small steps; then ramp pressures against the cord."""
    with rig.recording("force_not_pressurised") as paths:
        rig.wait(2.0)
        pull_steps(rig, "tip", azimuths=(0.4, 2.5), steps=10, travel=0.07, rest_s=1.5)
    still = rig.load(paths[0])
    with rig.recording("force_pressurised") as paths:
        rig.wait(2.0)
        for azimuth in first_azimuths(rig.specimen, 2):
            against_the_cord(rig, azimuth, np.ones(1), ramp_s=8.0, hold_s=0.5)
    return still, rig.load(paths[0])


def teach_live(rig: LiveRig, seed: int) -> tuple[Recording, ...]:
    """Show poses by hand, let the service hold each, and measure.

    The recording notes when the averaging windows of shown and held poses ended [s], ``looks``, whether the
    service called each pose reachable, ``reachable``, and how near pressures come, ``limits``.
    """
    rng = np.random.default_rng(seed)
    shown: list[float] = []
    held: list[float] = []
    holds: list[Hold] = []
    with rig.recording("teach") as paths:
        rig.wait(0.5)
        rest = rig.position("tip")
        for _ in range(TAUGHT):
            goal = rest + rng.uniform((-REACH_M, -REACH_M, 0.0), (REACH_M, REACH_M, DRAWN_M))
            begin, end, hold = _show_and_hold(rig, rest, goal)
            shown.append(begin)
            held.append(end)
            holds.append(hold)
            rig.advance()
    recording = rig.load(paths[0])
    answers = {"reachable": [hold.reachable for hold in holds], "limits": [hold.note for hold in holds]}
    return (replace(recording, info={**recording.info, "looks": [shown, held], **answers}),)


def _show_and_hold(rig: LiveRig, rest: Floats, goal: Floats) -> tuple[float, float, Hold]:
    """Show one pose, let the service hold it, and let go.

    Returns:
        Ends of the averaging windows of the shown and the held pose [s], and the service's answer.

    Raises:
        WorkFailedError: The hold ended by itself.
    """
    rig.arm()
    rig.client.teach.start()
    for share in np.linspace(0.25, 1.0, 4):
        rig.operator.guide("tip", rest + share * (goal - rest))
        rig.wait(0.3)
    rig.wait(2.0)
    shown = rig.now
    hold = rig.client.teach.hold(ramp_s=1.5)
    rig.wait(1.8)
    rig.operator.release()
    rig.wait(4.0)
    held, mode = rig.now, rig.client.state().mode
    if mode != "HOLDING":
        raise WorkFailedError(f"the hold ended by itself ({mode}); see the service's log")
    rig.disarm()
    rig.wait(1.5)
    return shown, held, hold

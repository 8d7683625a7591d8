"""From the place of an effect to the parts of the arm it changes."""

from collections.abc import Callable
from dataclasses import replace

from softarm.estimator.errors import InputError
from softarm.fakes.plant.effects.effect import Where
from softarm.fakes.plant.parameters import ArmParameters, Memory, PlantSegment


def change_segments(
    arm: ArmParameters, where: Where, change: Callable[[PlantSegment], PlantSegment]
) -> ArmParameters:
    """Change the segment that is named, or all of them when none is."""
    names = [segment.name for segment in arm.segments]
    chosen = where.get("segment")
    if chosen is not None and chosen not in names:
        raise InputError("segment", f"no segment '{chosen}'", f"one of {', '.join(names)}")
    segments = (change(s) if chosen in (None, s.name) else s for s in arm.segments)
    return replace(arm, segments=tuple(segments))


def change_memory(arm: ArmParameters, where: Where, change: Callable[[Memory], Memory]) -> ArmParameters:
    """Change what the rubber of a segment, or of all, remembers."""
    return change_segments(arm, where, lambda segment: replace(segment, memory=change(segment.memory)))


def chosen_chambers(arm: ArmParameters, where: Where) -> tuple[int, ...]:
    """List the chamber that is given, or all of them when none is."""
    if "chamber" not in where:
        return tuple(range(arm.chambers))
    chamber = int(where["chamber"])
    if not 0 <= chamber < arm.chambers:
        raise InputError("chamber", f"no chamber {chamber}", f"0 to {arm.chambers - 1}")
    return (chamber,)


def chosen_section(arm: ArmParameters, where: Where) -> str:
    """Name the moving section that is given, or the tip."""
    section = str(where.get("section", arm.sections[-1]))
    if section not in arm.sections[1:]:
        raise InputError("section", f"no moving section '{section}'", f"one of {', '.join(arm.sections[1:])}")
    return section


def azimuth(where: Where) -> float:
    """Read the direction in the cross-section [rad] from ``axis``: ``x``, ``y`` or an angle in degrees."""
    axis = where.get("axis", "x")
    named = {"x": 0.0, "y": 90.0, "-x": 180.0, "-y": 270.0}
    try:
        degrees = named[str(axis)] if str(axis) in named else float(axis)
    except ValueError:
        raise InputError("axis", f"'{axis}'", "x, y, -x, -y or an angle in degrees") from None
    return degrees * 3.141592653589793 / 180.0

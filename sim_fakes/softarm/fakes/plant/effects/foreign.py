"""Effects outside the diagnosis's vocabulary: what it must call unknown."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import EffectParameter, Numbers, Where, arm_effect
from softarm.fakes.plant.effects.places import change_segments, chosen_section
from softarm.fakes.plant.parameters import ArmParameters, ForceLoad


@arm_effect(loss=EffectParameter("", 12.0, 5.0, 25.0))
def curvature_area(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Lose ``loss`` times the squared stretch of the area.

    Chambers that collapse as they bend: their area falls with the square of their stretch.
    """
    first, second = arm.actuation.narrowing
    actuation = replace(arm.actuation, narrowing=(first, second + numbers["loss"]))
    return replace(arm, actuation=actuation)


@arm_effect(
    places=("segment",),
    stiffness=EffectParameter("", 1.0, 0.4, 3.0),
    curvature=EffectParameter("1/m", 2.5, 1.5, 3.5),
)
def curvature_locking(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add ``stiffness`` over that at rest beyond ``curvature``.

    A segment that locks beyond a curvature, as when fibres meet.
    """
    if numbers["stiffness"] == 0.0:
        return arm
    return change_segments(
        arm,
        where,
        lambda segment: replace(
            segment, locking=numbers["stiffness"], locking_curvature=numbers["curvature"]
        ),
    )


@arm_effect(
    places=("section",),
    force=EffectParameter("N", 0.06, 0.03, 0.15),
    period=EffectParameter("s", 7.0, 2.0, 20.0),
)
def periodic_disturbance(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Shake with ``force`` along the laboratory's x axis at ``period``.

    A draught or a machine that shakes a section at one frequency, whatever the arm does.
    """
    force = ForceLoad(chosen_section(arm, where), (numbers["force"], 0.0, 0.0), period=numbers["period"])
    return replace(arm, loads=replace(arm.loads, forces=(*arm.loads.forces, force)))


@arm_effect(share=EffectParameter("", 0.15, 0.08, 0.35))
def product_coupling(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Add ``share`` to the gain of a chamber per 50 kPa in the other chambers of its segment.

    Chambers of a segment that strengthen one another: each pushes more when its neighbours are full.
    """
    actuation = replace(arm.actuation, product=arm.actuation.product + numbers["share"])
    return replace(arm, actuation=actuation)


@arm_effect(strength=EffectParameter("Pa", 8e3, 4e3, 16e3), law=EffectParameter("", 1.0, 0.0, 1e6))
def random_law(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Push with ``strength``, by the law that the whole part of ``law`` draws.

    A law that nobody chose: a smooth random function of random states pushes a segment.
    """
    law = (numbers["strength"], int(numbers["law"]))
    return replace(arm, actuation=replace(arm.actuation, random_law=law))


@arm_effect(share=EffectParameter("", 0.06, 0.03, 0.12))
def swirl(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Apply a ``share`` of each pressure at the next azimuth, and its negative at the one before.

    Chambers that push at a slant: each also acts at one neighbour's azimuth, and against the other's.
    """
    matrix = [list(row) for row in arm.actuation.crosstalk]
    for group in arm.groups:
        for place, chamber in enumerate(group):
            matrix[group[(place + 1) % len(group)]][chamber] += numbers["share"]
            matrix[group[place - 1]][chamber] -= numbers["share"]
    crosstalk = tuple(tuple(row) for row in matrix)
    return replace(arm, actuation=replace(arm.actuation, crosstalk=crosstalk))


@arm_effect(growth=EffectParameter("", 0.2, 0.1, 0.4), pressure=EffectParameter("Pa", 32e3, 25e3, 40e3))
def wall_buckling(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Grow the area of every chamber by ``growth`` above ``pressure``.

    A chamber wall that snaps through above a pressure: its effective area jumps.
    """
    if numbers["growth"] == 0.0:
        return arm
    actuation = replace(arm.actuation, buckling=numbers["growth"], buckling_pressure=numbers["pressure"])
    return replace(arm, actuation=actuation)

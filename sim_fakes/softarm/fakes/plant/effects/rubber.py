"""Effects of the rubber: its modulus, its memory, its mass."""

from dataclasses import replace

import numpy as np

from softarm.fakes.plant.effects.effect import EffectParameter, Numbers, Where, arm_effect
from softarm.fakes.plant.effects.places import azimuth, change_memory, change_segments
from softarm.fakes.plant.parameters import ArmParameters, Defect, Memory, Warming

SPREAD = (0.4, 1.0, 2.5)


@arm_effect(change=EffectParameter("", 0.15, -0.2, 0.3))
def distributed_mass(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Scale all masses by 1 + ``change``: silicone and connectors denser or lighter than in the drawing."""
    factor = 1.0 + numbers["change"]
    rigid = tuple(mass * factor for mass in arm.rigid_masses)
    return replace(arm, density_factor=arm.density_factor * factor, rigid_masses=rigid)


@arm_effect(
    places=("segment",),
    strength=EffectParameter("", 0.30, 0.06, 0.60),
    width=EffectParameter("", 0.03, 0.015, 0.05),
    sharpness=EffectParameter("", 30.0, 2.0, 30.0),
)
def hysteresis(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add elements of total strength ``strength`` that slip about the strain ``width``.

    Hysteresis that no slowness removes: elastic-slip elements, smooth (Bouc-Wen) or three stops in a
    row.
    """
    spread = SPREAD if numbers["sharpness"] >= 20.0 else (1.0,)
    strengths = (numbers["strength"] / len(spread),) * len(spread)
    widths = tuple(numbers["width"] * share for share in spread)

    def slip(memory: Memory) -> Memory:
        if numbers["strength"] == 0.0:
            return memory
        return replace(
            memory,
            hysteresis=memory.hysteresis + strengths,
            widths=memory.widths + widths,
            sharpness=numbers["sharpness"],
        )

    return change_memory(arm, where, slip)


@arm_effect(places=("segment",), time=EffectParameter("s", 0.1, 0.015, 0.3))
def inertia_damping(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add ``time``: viscous force over elastic stiffness [s].

    More or less viscous damping than the rubber should have.
    """
    return change_segments(
        arm, where, lambda segment: replace(segment, damping_time=segment.damping_time + numbers["time"])
    )


@arm_effect(
    places=("segment", "axis"),
    change=EffectParameter("", -0.4, -0.6, 0.8),
    width=EffectParameter("rad", 2.0, 1.2, 2.4),
    start=EffectParameter("", 0.0, 0.0, 0.0),
    end=EffectParameter("", 1.0, 1.0, 1.0),
)
def local_stiffness_defect(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Scale the modulus by 1 + ``change`` within ``width`` [rad] of ``axis``, from ``start`` to ``end``.

    A patch of a segment that is softer or stiffer: a glue seam, a bubble, a repaired cut.
    """
    patch = Defect(
        azimuth(where), numbers["width"], numbers["start"], numbers["end"], 1.0 + numbers["change"]
    )
    usual = where.get("segment", arm.segments[0].name)
    return change_segments(
        arm, {"segment": usual}, lambda segment: replace(segment, defects=(*segment.defects, patch))
    )


@arm_effect(places=("segment",), strength=EffectParameter("", 0.4, 0.15, 1.0))
def material_softening(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Divide the stress at 20 % strain by 1 + strength, less below.

    Softening of the rubber with strain: the static response bends upwards.
    """
    return change_segments(
        arm, where, lambda segment: replace(segment, softening=segment.softening + numbers["strength"])
    )


@arm_effect(places=("segment",), strength=EffectParameter("", 0.4, 0.15, 1.0))
def material_stiffening(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Multiply the stress at 20 % strain by 1 + strength, with the square of the strain.

    Stiffening of the rubber with strain: the static response flattens out.
    """
    return change_segments(
        arm, where, lambda segment: replace(segment, stiffening=segment.stiffening + numbers["strength"])
    )


@arm_effect(
    places=("segment",),
    strength=EffectParameter("", 0.15, 0.06, 0.30),
    strain=EffectParameter("", 0.04, 0.02, 0.08),
)
def mullins_softening(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Drop a share ``strength`` of the stress over the distance ``strain`` below the largest strain.

    Mullins softening: the rubber is softer below the largest strain that it has seen.
    """
    return change_memory(
        arm,
        where,
        lambda memory: replace(
            memory, mullins=memory.mullins + numbers["strength"], mullins_strain=numbers["strain"]
        ),
    )


@arm_effect(places=("segment",), change=EffectParameter("", 0.2, -0.3, 0.4))
def segment_stiffness(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Scale the modulus by 1 + ``change``.

    A segment of another modulus.
    """
    return change_segments(
        arm, where, lambda segment: replace(segment, modulus=segment.modulus * (1.0 + numbers["change"]))
    )


@arm_effect(change=EffectParameter("", 0.2, -0.3, 0.4), time=EffectParameter("s", 400.0, 200.0, 800.0))
def thermal_drift(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Change all moduli by ``change`` with the time constant ``time`` from time 0.

    Moduli that drift with the temperature over the run.
    """
    return replace(arm, warming=Warming(arm.warming.change + numbers["change"], numbers["time"]))


@arm_effect(
    places=("segment",),
    strength=EffectParameter("", 0.15, 0.03, 0.30),
    time=EffectParameter("s", 8.0, 3.0, 20.0),
    decades=EffectParameter("", 0.0, 0.0, 2.0),
)
def viscoelastic_creep(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add branches of total strength ``strength``, spread over ``decades`` around ``time``.

    Creep: Maxwell branches beside the rubber, one, three, or a spectrum that is flat over decades.
    """
    branches = max(1, round(2.0 * numbers["decades"]) + 1)
    exponents = np.linspace(-0.5, 0.5, branches) * numbers["decades"]
    times = tuple(float(t) for t in numbers["time"] * 10.0**exponents)
    strengths = (numbers["strength"] / branches,) * branches

    def creep(memory: Memory) -> Memory:
        return replace(memory, relaxation=memory.relaxation + strengths, times=memory.times + times)

    return change_memory(arm, where, creep)

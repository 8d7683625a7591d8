"""Effects of what the arm is clamped to, carries and meets."""

from dataclasses import replace

import numpy as np

from softarm.fakes.plant.effects.effect import EffectParameter, Numbers, Where, arm_effect
from softarm.fakes.plant.effects.places import azimuth, chosen_section
from softarm.fakes.plant.parameters import ArmParameters, ForceLoad, Obstacle, Payload, Tether


@arm_effect(compliance=EffectParameter("rad/(N m)", 0.3, 0.1, 1.0))
def base_compliance(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Add ``compliance`` about both axes.

    A base plate that rotates under the moment of the arm.
    """
    about_x, about_y = arm.support.compliance
    more = numbers["compliance"]
    return replace(arm, support=replace(arm.support, compliance=(about_x + more, about_y + more)))


@arm_effect(places=("axis",), angle=EffectParameter("rad", 0.05, 0.02, 0.1))
def base_tilt(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Rotate the clamp by ``angle`` about the direction ``axis`` of the base plate.

    A clamp that does not sit square in its mount.
    """
    direction = azimuth(where)
    tilt = (
        arm.support.tilt[0] + numbers["angle"] * float(np.cos(direction)),
        arm.support.tilt[1] + numbers["angle"] * float(np.sin(direction)),
    )
    return replace(arm, support=replace(arm.support, tilt=tilt))


@arm_effect(
    places=("axis",),
    stiffness=EffectParameter("N/m", 300.0, 100.0, 800.0),
    distance=EffectParameter("m", 0.06, 0.04, 0.08),
)
def contact_obstacle(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Place a plane beside the arm, ``distance`` from its axis in the direction ``axis``.

    Something that the arm touches in part of its space.
    """
    if numbers["stiffness"] == 0.0:
        return arm
    angle = azimuth(where)
    outward = np.array([np.cos(angle), np.sin(angle), 0.0])
    point = numbers["distance"] * outward
    wall = Obstacle(
        "plane",
        (float(point[0]), float(point[1]), 0.0),
        (float(-outward[0]), float(-outward[1]), 0.0),
        numbers["stiffness"],
    )
    return replace(arm, loads=replace(arm.loads, obstacles=(*arm.loads.obstacles, wall)))


@arm_effect(
    places=("section",),
    force=EffectParameter("N", 0.1, 0.02, 0.3),
    x=EffectParameter("", 1.0, -1.0, 1.0),
    y=EffectParameter("", 0.0, -1.0, 1.0),
    z=EffectParameter("", 0.0, -0.5, 0.5),
    start=EffectParameter("s", 0.0, 0.0, 0.0),
)
def external_force(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Pull with ``force`` times the direction (``x``, ``y``, ``z``, laboratory frame) from ``start`` on.

    A force on a section, constant once it has set in.
    """
    direction = (numbers["x"], numbers["y"], numbers["z"])
    size = sum(c * c for c in direction) ** 0.5
    amplitude = (
        numbers["force"] * direction[0] / size,
        numbers["force"] * direction[1] / size,
        numbers["force"] * direction[2] / size,
    )
    force = ForceLoad(chosen_section(arm, where), amplitude, start=numbers["start"])
    return replace(arm, loads=replace(arm.loads, forces=(*arm.loads.forces, force)))


@arm_effect(
    places=("section", "axis"),
    stiffness=EffectParameter("N/m", 4.0, 1.0, 15.0),
    reach=EffectParameter("m", 0.3, 0.3, 0.3),
    slack=EffectParameter("m", 0.02, 0.0, 0.04),
)
def tether_stiffness(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Tie a section to a point ``reach`` beside its rest position, with ``slack`` to spare.

    A tube or cable that pulls on a section once it is taut.
    """
    if numbers["stiffness"] == 0.0:
        return arm
    section, angle = chosen_section(arm, where), azimuth(where)
    height = arm.frames[arm.sections.index(section)].origin[2]
    anchor = (numbers["reach"] * float(np.cos(angle)), numbers["reach"] * float(np.sin(angle)), height)
    tether = Tether(section, anchor, numbers["reach"] + numbers["slack"], numbers["stiffness"])
    return replace(arm, loads=replace(arm.loads, tethers=(*arm.loads.tethers, tether)))


@arm_effect(
    places=("section",),
    mass=EffectParameter("kg", 0.02, 0.003, 0.05),
    below=EffectParameter("m", 0.005, 0.0, 0.02),
)
def tip_payload(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Fix ``mass`` to a section, ``below`` its origin.

    A weight that nobody mentioned.
    """
    if numbers["mass"] == 0.0:
        return arm
    payload = Payload(chosen_section(arm, where), numbers["mass"], (0.0, 0.0, numbers["below"]))
    return replace(arm, loads=replace(arm.loads, payloads=(*arm.loads.payloads, payload)))

"""The arm as a chain of rigid bodies in MuJoCo; elastic and pneumatic forces are added at its joints.

Each soft segment is cut in equal pieces; at the middle of each piece sit three slides, along the arm and
across it, and below them a ball joint: the piece stretches and shears in the frame of the link above, and the
next link rotates about the point that it moves to. MuJoCo's world is the base frame. The joints carry only
viscous damping in MuJoCo, which ``ForwardDynamics`` treats implicitly and which therefore keeps the explicit
elastic forces stable.
"""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.fakes.plant.cross_section import CrossSection, lobed
from softarm.fakes.plant.parameters import GRAVITY, ArmParameters, PlantSegment
from softarm.fakes.plant.rotations import rotation_matrix, vector_quaternion

Integers = NDArray[np.int64]

SUPPORT_DAMPING_TIME = 0.006
SLIDES, BALL = ("slide_x", "slide_y", "slide_z"), "ball"


@dataclass(frozen=True)
class Joint:
    """One elastic joint.

    Args:
        segment: Index of its segment.
        share: Where it sits along the segment, 0 to 1.
        height: Its rest height [m].
        length: Of the piece whose deformation it gathers [m].
        section: Cross-section there.
    """

    segment: int
    share: float
    height: float
    length: float
    section: CrossSection


@dataclass(frozen=True)
class PlantChain:
    """The compiled model and where its parts are.

    Args:
        model: MuJoCo model.
        joints: Elastic joints from the base to the tip.
        slides: Addresses in the velocity of the slides along x, y and z of the link above, shape (joints, 3).
        slide_positions: The same in the position, shape (joints, 3).
        balls: Addresses of the balls in the velocity, shape (joints, 3).
        ball_positions: Addresses of their quaternions in the position, shape (joints, 4).
        bodies: Bodies of the links, one per joint, shape (joints,).
        radii: Outer radius at each link [m], shape (joints,).
        sections: Sites of the sections' frames, shape (sections,).
        section_bodies: Bodies that carry them, shape (sections,).
        link_sections: Section that each link is counted to, shape (joints,).
    """

    model: mujoco.MjModel
    joints: tuple[Joint, ...]
    slides: Integers
    slide_positions: Integers
    balls: Integers
    ball_positions: Integers
    bodies: Integers
    radii: Floats
    sections: Integers
    section_bodies: Integers
    link_sections: Integers


def build(parameters: ArmParameters) -> PlantChain:
    """Build the chain of an arm.

    Raises:
        InputError: A part would have negative mass.
    """
    joints = tuple(joint for index in range(len(parameters.segments)) for joint in _joints(parameters, index))
    spec = mujoco.MjSpec()
    spec.option.timestep = parameters.step
    spec.option.gravity = gravity_in_base(parameters)
    masses = _masses(parameters, joints)
    if min(masses.min(), *(payload.mass for payload in parameters.loads.payloads), 1.0) < 0.0:
        raise InputError("fake arm", "a part of negative mass", "give masses and densities above 0")
    body, height = _support(spec, parameters), 0.0
    for index, (joint, mass) in enumerate(zip(joints, masses, strict=True)):
        body = _link(body, index, joint, joint.height - height, mass, parameters)
        height = joint.height
        _attach_sections(body, index, joints, parameters)
    return _locate(spec.compile(), joints, parameters)


def gravity_in_base(parameters: ArmParameters) -> Floats:
    """Return the gravitational acceleration in the base frame [m/s2]."""
    into_base = rotation_matrix(np.array(parameters.mount.quaternion)).T
    return np.asarray(into_base @ np.array([0.0, 0.0, -GRAVITY]))


def _joints(parameters: ArmParameters, index: int) -> list[Joint]:
    """Cut one segment."""
    segment = parameters.segments[index]
    length = segment.length / segment.links
    joints = []
    for number in range(segment.links):
        share = (number + 0.5) / segment.links
        section = _section(parameters, segment, number)
        joints.append(Joint(index, share, segment.start + share * segment.length, length, section))
    return joints


def _section(parameters: ArmParameters, segment: PlantSegment, number: int) -> CrossSection:
    """Return the cross-section at a link."""
    if segment.cross_sections:
        return segment.cross_sections[number]
    radius = float(np.interp((number + 0.5) / segment.links, (0.0, 1.0), segment.radii))
    return lobed(radius, parameters.wall, parameters.floor, parameters.fibre_depth, parameters.azimuths)


def _masses(parameters: ArmParameters, joints: tuple[Joint, ...]) -> Floats:
    """Share the silicone's mass by area, and add the rigid part to the last link of each segment [kg]."""
    masses = np.zeros(len(joints))
    for index, segment in enumerate(parameters.segments):
        joint_indices = [k for k, joint in enumerate(joints) if joint.segment == index]
        areas = np.array([joints[k].section.areas.sum() for k in joint_indices])
        masses[joint_indices] = parameters.density_factor * segment.mass * areas / areas.sum()
        masses[joint_indices[-1]] += parameters.rigid_masses[index]
    return masses


def _support(spec: mujoco.MjSpec, parameters: ArmParameters) -> mujoco.MjsBody:
    """Make the base plate, which rotates on its compliance, and the clamp on it, which may be tilted."""
    plate = spec.worldbody.add_body(name="plate")
    plate.explicitinertial = True
    plate.mass = 0.3
    plate.inertia = [2e-4, 2e-4, 2e-4]
    for name, axis, compliance in zip("xy", np.eye(3)[:2], parameters.support.compliance, strict=True):
        if compliance > 0.0:
            plate.add_joint(
                name=f"support_{name}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis,
                stiffness=1.0 / compliance,
                damping=SUPPORT_DAMPING_TIME / compliance,
            )
    base = parameters.frames[0]
    plate.add_site(name=base.name, pos=base.origin, quat=base.quaternion)
    clamp: mujoco.MjsBody = plate.add_body(name="clamp")
    clamp.quat = vector_quaternion(np.array([*parameters.support.tilt, 0.0]))
    return clamp


def _link(
    parent: mujoco.MjsBody, index: int, joint: Joint, offset: float, mass: float, parameters: ArmParameters
) -> mujoco.MjsBody:
    """Hang one link on the chain: a uniform piece of the arm below its joint."""
    segment = parameters.segments[joint.segment]
    last = joint.share + 1.0 / segment.links > 1.0
    length = joint.length * 0.5 + parameters.rigid_lengths[joint.segment] if last else joint.length
    body = parent.add_body(name=f"link_{index}", pos=[0.0, 0.0, offset])
    across = 0.5 * float(
        joint.section.areas @ (joint.section.fibres**2).sum(axis=1) / joint.section.areas.sum()
    )
    slender = length**2 / 12.0
    body.explicitinertial = True
    body.mass = mass
    body.ipos = [0.0, 0.0, 0.5 * length]
    body.inertia = mass * np.array([across + slender, across + slender, 2.0 * across])
    rest = rest_stiffness(segment, joint)
    for name, axis, stiffness in zip(SLIDES, np.eye(3), (rest.shear, rest.shear, rest.axial), strict=True):
        body.add_joint(
            name=f"{name}_{index}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            damping=segment.damping_time * stiffness,
        )
    body.add_joint(
        name=f"{BALL}_{index}",
        type=mujoco.mjtJoint.mjJNT_BALL,
        damping=segment.damping_time * max(rest.bending, rest.torsion),
    )
    return body


class RestStiffness(NamedTuple):
    """Stiffness of a joint at rest.

    Args:
        axial: Of the slide along the arm [N/m].
        shear: Of the slides across it [N/m].
        bending: Of the ball about x and y, mean of both [N m/rad].
        torsion: About z [N m/rad].
    """

    axial: float
    shear: float
    bending: float
    torsion: float


def rest_stiffness(segment: PlantSegment, joint: Joint) -> RestStiffness:
    """Return the stiffness of a joint at rest: E A, k G A, E I and G J, each over the length of its piece.

    G is the segment's ``torsion`` times E and J is 2 I, as of a round section; k is ``shear_coefficient``
    times the segment's ``shear``.
    """
    section = joint.section
    area = float(section.areas.sum())
    per_length = segment.modulus / joint.length
    shear = segment.shear * shear_coefficient(area, section.second_moment) * segment.torsion
    return RestStiffness(
        axial=per_length * area,
        shear=shear * per_length * area,
        bending=per_length * section.second_moment,
        torsion=2.0 * segment.torsion * per_length * section.second_moment,
    )


def shear_coefficient(area: float, second_moment: float) -> float:
    """Return the share of a cross-section's area that resists shear, as of a round pipe of the same A and I.

    For a pipe of Poisson's ratio 1/2 whose inner radius is m times the outer, G. R. Cowper (J. Appl. Mech.
    33, 1966, 335-340) has k = 9 (1 + m^2)^2 / (10 (1 + m^2)^2 + 26 m^2). With q = A^2 / (4 pi I) =
    (1 - m^2) / (1 + m^2) that is 9 / (10 + 6.5 (1 - q^2)): 0.9 for a rod, 0.545 for a thin pipe.

    Args:
        area: Of the material [m2].
        second_moment: About an axis through the centre [m4].
    """
    filled = min(1.0, area**2 / (4.0 * np.pi * second_moment))
    return 9.0 / (10.0 + 6.5 * (1.0 - filled**2))


def _attach_sections(
    body: mujoco.MjsBody, index: int, joints: tuple[Joint, ...], parameters: ArmParameters
) -> None:
    """Put the section's frame and its payloads on the last link of a segment."""
    joint = joints[index]
    if index + 1 < len(joints) and joints[index + 1].segment == joint.segment:
        return
    frame = parameters.frames[joint.segment + 1]
    name, origin = frame.name, np.array(frame.origin) - [0.0, 0.0, joint.height]
    body.add_site(name=name, pos=origin, quat=frame.quaternion)
    for number, payload in enumerate(parameters.loads.payloads):
        if payload.section == name:
            weight = body.add_body(name=f"payload_{number}", pos=origin + np.array(payload.offset))
            weight.explicitinertial = True
            weight.mass = payload.mass
            weight.inertia = payload.mass * np.full(3, 0.4 * 0.008**2)


def _locate(model: mujoco.MjModel, joints: tuple[Joint, ...], parameters: ArmParameters) -> PlantChain:
    """Find the addresses of the chain's parts."""
    slides = [[model.joint(f"{name}_{k}") for name in SLIDES] for k in range(len(joints))]
    balls = [model.joint(f"{BALL}_{k}") for k in range(len(joints))]
    sites = [model.site(name) for name in parameters.sections]
    return PlantChain(
        model=model,
        joints=joints,
        slides=np.array([[slide.dofadr[0] for slide in row] for row in slides], dtype=np.int64),
        slide_positions=np.array([[slide.qposadr[0] for slide in row] for row in slides], dtype=np.int64),
        balls=np.array([ball.dofadr[0] for ball in balls])[:, None] + np.arange(3),
        ball_positions=np.array([ball.qposadr[0] for ball in balls])[:, None] + np.arange(4),
        bodies=np.array([model.body(f"link_{k}").id for k in range(len(joints))], dtype=np.int64),
        radii=np.array([joint.section.radius for joint in joints]),
        sections=np.array([site.id for site in sites], dtype=np.int64),
        section_bodies=np.array([site.bodyid[0] for site in sites], dtype=np.int64),
        link_sections=np.array([joint.segment + 1 for joint in joints], dtype=np.int64),
    )

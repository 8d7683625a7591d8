"""The rubber: fibres along the arm, each with its own nonlinear stress and memory.

At each joint the cross-section is a bundle of fibres. A fibre at (x, y) is strained by the slide s along
the arm and the rotation vector (a, b, c) of the joint over the piece's length l:
strain = (s + a y - b x) / l. Its stress is

    E [ (stretch - stretch^-n) / (n + 1) * shape(strain)
        + sum_i g_i (strain - relaxed_i) + sum_k w_k slip_k ] * eta,

relaxed_i following the strain with time constant tau_i (Maxwell branches), slip_k an elastic-slip
element that yields at its width (Bouc 1967, Wen 1976; a stop operator when sharp), and
eta = 1 - m (1 - exp(-(largest - |strain|) / e)) the softening below the largest strain so far. A chamber
pushes its column apart with pressure times an area that depends on its own stretch. Twist and the slides
across the arm are resisted linearly (S. P. Timoshenko, Phil. Mag. 41, 1921).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.chain import Joint, rest_stiffness
from softarm.fakes.plant.parameters import ArmParameters, PlantSegment

REFERENCE_STRAIN = 0.2
EXACT_STOP = 20.0


@dataclass(frozen=True)
class FibreTable:
    """Constants of all fibres and chambers; J joints, F fibres, B branches, S slip elements, C chambers.

    Args:
        fibres: Centres [m], shape (J, F, 2).
        forces: Modulus times area [N], shape (J, F).
        lengths: Of the pieces [m], shape (J,).
        law: Exponent, stiffening, softening, locking curvature [1/m], locking bending stiffness [N m/rad],
            torsional stiffness [N m/rad], shear stiffness [N/m], shape (J, 7).
        relaxation: Branch strengths, shape (J, B).
        follow: Share of the way each branch follows in a step, shape (J, B).
        slip: Strengths, shape (J, S).
        widths: Strains of slip, shape (J, S).
        softening: Sharpness of slip, Mullins loss and its strain, shape (J, 3).
        chambers: Centroids and area [m, m, m2], shape (J, C, 3).
    """

    fibres: Floats
    forces: Floats
    lengths: Floats
    law: Floats
    relaxation: Floats
    follow: Floats
    slip: Floats
    widths: Floats
    softening: Floats
    chambers: Floats


@dataclass(frozen=True)
class FibreMemory:
    """What the fibres remember; changed in place by ``joint_forces``.

    Args:
        relaxed: Shape (J, F, B).
        slipped: Shape (J, F, S).
        last: Strain at the last step, shape (J, F).
        largest: Largest size of strain so far, shape (J, F).
    """

    relaxed: Floats
    slipped: Floats
    last: Floats
    largest: Floats


def tabulate(parameters: ArmParameters, joints: tuple[Joint, ...]) -> FibreTable:
    """Lay out the constants of an arm for the kernel."""
    segments = [parameters.segments[joint.segment] for joint in joints]
    moduli = [_moduli(segment, joint) for segment, joint in zip(segments, joints, strict=True)]
    return FibreTable(
        fibres=np.array([joint.section.fibres for joint in joints]),
        forces=np.array(
            [modulus * joint.section.areas for modulus, joint in zip(moduli, joints, strict=True)]
        ),
        lengths=np.array([joint.length for joint in joints]),
        law=np.array([_law(segment, joint) for segment, joint in zip(segments, joints, strict=True)]),
        relaxation=_padded([segment.memory.relaxation for segment in segments], 0.0),
        follow=-np.expm1(-parameters.step / _padded([segment.memory.times for segment in segments], 1.0)),
        slip=_padded([segment.memory.hysteresis for segment in segments], 0.0),
        widths=_padded([segment.memory.widths for segment in segments], 1.0),
        softening=np.array(
            [[s.memory.sharpness, s.memory.mullins, s.memory.mullins_strain] for s in segments]
        ),
        chambers=_padded_chambers(joints),
    )


def fresh_memory(table: FibreTable) -> FibreMemory:
    """Make the memory of an arm that has never moved."""
    joints, fibres = table.forces.shape
    return FibreMemory(
        relaxed=np.zeros((joints, fibres, table.relaxation.shape[1])),
        slipped=np.zeros((joints, fibres, table.slip.shape[1])),
        last=np.zeros((joints, fibres)),
        largest=np.zeros((joints, fibres)),
    )


def _moduli(segment: PlantSegment, joint: Joint) -> Floats:
    """Return the modulus of each fibre of a joint [Pa], defects included."""
    azimuth = np.arctan2(joint.section.fibres[:, 1], joint.section.fibres[:, 0])
    moduli = np.full(len(azimuth), segment.modulus)
    for defect in segment.defects:
        away = np.abs((azimuth - defect.azimuth + np.pi) % (2.0 * np.pi) - np.pi)
        if defect.start <= joint.share <= defect.end:
            moduli[away <= 0.5 * defect.width] *= defect.factor
    return moduli


def _law(segment: PlantSegment, joint: Joint) -> list[float]:
    """Return the row of ``FibreTable.law`` of a joint."""
    rest = rest_stiffness(segment, joint)
    return [
        segment.exponent,
        segment.stiffening,
        segment.softening,
        segment.locking_curvature,
        segment.locking * rest.bending,
        rest.torsion,
        rest.shear,
    ]


def _padded(rows: list[tuple[float, ...]], fill: float) -> Floats:
    """Stack rows of unequal length, at least one column wide."""
    table = np.full((len(rows), max(1, *(len(row) for row in rows))), fill)
    for index, row in enumerate(rows):
        table[index, : len(row)] = row
    return table


def _padded_chambers(joints: tuple[Joint, ...]) -> Floats:
    """Stack the chambers of each joint, those that it lacks without an area."""
    table = np.zeros((len(joints), max(len(joint.section.chamber_areas) for joint in joints), 3))
    for index, joint in enumerate(joints):
        section = joint.section
        table[index, : len(section.chamber_areas)] = np.column_stack(
            [section.chambers, section.chamber_areas]
        )
    return table


def joint_forces(
    table: FibreTable,
    memory: FibreMemory,
    motion: tuple[Floats, Floats],
    pressures: Floats,
    actuation: Floats,
    modulus_factor: float,
    settling: bool,
) -> Floats:
    """Return the force of the slides and the torque of the ball of each joint, and step the memory.

    Args:
        table: Constants.
        memory: Changed in place.
        motion: Slides [m], shape (J, 3), and quaternions of the balls, shape (J, 4).
        pressures: Effective gauge pressure of the chambers at each joint [Pa], shape (J, C).
        actuation: Loss of area per stretch (first and second order) and torque per pressure force [m].
        modulus_factor: Scale of all moduli, such as of the temperature.
        settling: Keep the memory at rest: branches relaxed, nothing slipped, never stretched.

    Returns:
        Force in the frame of the link above [N] and torque in the link's own [N m], shape (J, 6).
    """
    slides, quaternions = motion
    forces = np.zeros((len(slides), 6))
    _joint_forces(
        table.fibres, table.forces, table.lengths, table.law, table.relaxation, table.follow, table.slip,
        table.widths, table.softening, table.chambers, memory.relaxed, memory.slipped, memory.last,
        memory.largest, slides, quaternions, pressures, actuation, modulus_factor, settling, forces,
    )  # fmt: skip
    return forces


@njit(cache=True, nogil=True)
def _joint_forces(  # type: ignore[no-untyped-def]
    fibres, fibre_forces, lengths, law, relaxation, follow, slip, widths, softening, chambers, relaxed,
    slipped, last, largest, slides, quaternions, pressures, actuation, modulus_factor, settling, forces,
):  # fmt: skip
    """Sum the stresses over each cross-section, see the module."""
    for j in range(len(slides)):
        a, b, c = _rotation_vector(quaternions[j])
        length = lengths[j]
        axial, about_x, about_y = 0.0, 0.0, 0.0
        for f in range(fibres.shape[1]):
            x, y = fibres[j, f, 0], fibres[j, f, 1]
            strain = (slides[j, 2] + a * y - b * x) / length
            stress = _elastic(strain, law[j, 0], law[j, 1], law[j, 2])
            stress += _relaxing(strain, relaxation[j], follow[j], relaxed[j, f], settling)
            stress += _slipping(
                strain - last[j, f], slip[j], widths[j], softening[j, 0], slipped[j, f], settling
            )
            last[j, f] = strain
            size = abs(strain)
            largest[j, f] = size if settling else max(size, largest[j, f])
            if softening[j, 1] != 0.0:
                stress *= 1.0 + softening[j, 1] * np.expm1((size - largest[j, f]) / softening[j, 2])
            force = modulus_factor * fibre_forces[j, f] * stress
            axial -= force
            about_x -= force * y
            about_y += force * x
        about_z = -modulus_factor * law[j, 5] * c
        for k in range(chambers.shape[1]):
            x, y = chambers[j, k, 0], chambers[j, k, 1]
            stretch = (slides[j, 2] + a * y - b * x) / length
            area = chambers[j, k, 2] * (1.0 - actuation[0] * stretch - actuation[1] * stretch * stretch)
            push = pressures[j, k] * area
            axial += push
            about_x += push * y
            about_y -= push * x
            about_z += actuation[2] * push
        curvature = np.sqrt(a * a + b * b) / length
        if law[j, 3] > 0.0 and curvature > law[j, 3]:
            lock = law[j, 4] * (1.0 - law[j, 3] / curvature)
            about_x -= lock * a
            about_y -= lock * b
        forces[j, 0] = -modulus_factor * law[j, 6] * slides[j, 0]
        forces[j, 1] = -modulus_factor * law[j, 6] * slides[j, 1]
        forces[j, 2] = axial
        _to_link(a, b, c, about_x, about_y, about_z, forces[j, 3:])


@njit(cache=True, nogil=True)
def _elastic(strain, exponent, stiffening, softening):  # type: ignore[no-untyped-def]
    """Return the long-term stress over the modulus."""
    stretch = 1.0 + strain
    share = abs(strain) / REFERENCE_STRAIN
    shape = (1.0 + stiffening * share * share) / (1.0 + softening * share)
    if exponent == 3.0:
        return 0.25 * shape * (stretch - 1.0 / (stretch * stretch * stretch))
    return shape * (stretch - stretch ** (-exponent)) / (exponent + 1.0)


@njit(cache=True, nogil=True)
def _relaxing(strain, strengths, follow, relaxed, settling):  # type: ignore[no-untyped-def]
    """Return the stress of the Maxwell branches over the modulus, and step them."""
    stress = 0.0
    for i in range(len(strengths)):
        relaxed[i] += (1.0 if settling else follow[i]) * (strain - relaxed[i])
        stress += strengths[i] * (strain - relaxed[i])
    return stress


@njit(cache=True, nogil=True)
def _slipping(change, strengths, widths, sharpness, slipped, settling):  # type: ignore[no-untyped-def]
    """Return the stress of the elastic-slip elements over the modulus, and step them."""
    stress = 0.0
    for k in range(len(strengths)):
        moved = slipped[k] + change
        if sharpness < EXACT_STOP and change * slipped[k] > 0.0:
            moved = slipped[k] + change * (1.0 - min(1.0, abs(slipped[k]) / widths[k]) ** sharpness)
        slipped[k] = 0.0 if settling else min(max(moved, -widths[k]), widths[k])
        stress += strengths[k] * slipped[k]
    return stress


@njit(cache=True, nogil=True)
def _rotation_vector(quaternion):  # type: ignore[no-untyped-def]
    """Return the rotation vector of a unit quaternion."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < 1e-9 else 2.0 * np.arctan2(sine, w) / sine
    return scale * x, scale * y, scale * z


@njit(cache=True, nogil=True)
def _to_link(a, b, c, about_x, about_y, about_z, out):  # type: ignore[no-untyped-def]
    """Convert the force conjugate to the rotation vector v to the torque in the link's frame.

    The vector's rate is (I + [v]/2 + k [v]^2) times the link's angular velocity, with
    k = 1/angle^2 - (1 + cos angle) / (2 angle sin angle), so the torque is its transpose times the force.
    """
    square = a * a + b * b + c * c
    angle = np.sqrt(square)
    k = 1.0 / 12.0
    if angle > 1e-3:
        k = 1.0 / square - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    dot = a * about_x + b * about_y + c * about_z
    out[0] = about_x - 0.5 * (b * about_z - c * about_y) + k * (a * dot - square * about_x)
    out[1] = about_y - 0.5 * (c * about_x - a * about_z) + k * (b * dot - square * about_y)
    out[2] = about_z - 0.5 * (a * about_y - b * about_x) + k * (c * dot - square * about_z)

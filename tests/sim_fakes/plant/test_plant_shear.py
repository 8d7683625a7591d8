"""The fake arm shears as a Timoshenko beam does."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.chain import build, rest_stiffness, shear_coefficient
from softarm.fakes.plant.cross_section import CrossSection, sampled
from softarm.fakes.plant.material import fresh_memory, joint_forces, tabulate
from softarm.fakes.plant.parameters import (
    ArmParameters,
    ForceLoad,
    Loads,
    Memory,
    PlantFrame,
    PlantSegment,
    sopra,
)
from softarm.fakes.plant.rotations import product, vector_quaternion
from softarm.fakes.plant.state import Hand, PlantInputs
from softarm.fakes.plant.variants import SHEAR_TOLERANCE, variant
from tests.sim_fakes.plant.driving import MakeArm, hold

OUTER, INNER, LENGTH, MODULUS, POISSON = 0.015, 0.009, 0.06, 300e3, 0.5
NOTHING_REMEMBERED = Memory(relaxation=(), times=(), hysteresis=(), widths=())
VENTED = PlantInputs(np.zeros(6))


def cowper(share: float) -> float:
    """Return the shear coefficient of a pipe whose inner radius is this share of its outer one."""
    square = (1.0 + share**2) ** 2
    return 6.0 * (1.0 + POISSON) * square / ((7 + 6 * POISSON) * square + (20 + 12 * POISSON) * share**2)


def pipe() -> CrossSection:
    """Sample a pipe."""
    axis = np.linspace(-OUTER, OUTER, 601)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.hypot(*points.T)
    chamber = np.abs(points - [0.012, 0.0]).max(axis=1) < 0.002
    return sampled(points, axis[1] - axis[0], (distance < OUTER) & (distance > INNER), [chamber])


def beam(force: float = 0.0, links: int = 20) -> ArmParameters:
    """Make a straight pipe of linear rubber and next to no weight, a force on its end."""
    segment = PlantSegment(
        "beam", 0.0, LENGTH, (OUTER, OUTER), 1e-5, links=links, modulus=MODULUS, torsion=1.0 / 3.0,
        memory=NOTHING_REMEMBERED, chambers=(0,), cross_sections=(pipe(),) * links,
    )  # fmt: skip
    own = sopra()
    return replace(
        own,
        segments=(segment,),
        frames=(PlantFrame("base", (0.0, 0.0, 0.0)), PlantFrame("tip", (0.0, 0.0, LENGTH))),
        rigid_masses=(1e-6,),
        rigid_lengths=(1e-3,),
        loads=Loads(forces=(ForceLoad("tip", (force, 0.0, 0.0)),)),
        actuation=replace(own.actuation, gains=(1.0,), crosstalk=((0.0,),), lags=(0.01,), leak_rates=(0.0,)),
    )


def quaternions_of(vectors: Floats) -> Floats:
    """Return the quaternions of rotation vectors, shape (n, 4)."""
    return np.array([vector_quaternion(vector) for vector in vectors])


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9, 0.999])
def test_the_coefficient_of_a_pipe_is_that_of_cowper(share: float) -> None:
    area, second_moment = np.pi * (1.0 - share**2), 0.25 * np.pi * (1.0 - share**4)
    assert shear_coefficient(area, second_moment) == pytest.approx(cowper(share))


def test_rods_and_thin_pipes_have_the_coefficients_in_his_table() -> None:
    assert cowper(0.0) == pytest.approx(6.0 * (1.0 + POISSON) / (7.0 + 6.0 * POISSON))
    assert cowper(1.0) == pytest.approx(2.0 * (1.0 + POISSON) / (4.0 + 3.0 * POISSON))


def test_a_cantilever_bends_and_shears_as_timoshenko_has_it() -> None:
    """F L^3 / (3 E I) + F L / (k G A), a third of which is shear."""
    force = 0.02
    arm, free = FakeArm(beam(force)), FakeArm(beam())
    moved = (hold(arm, PlantInputs(np.zeros(1)), 1.0).positions - free.state.positions)[-1, 0]
    area, second_moment = np.pi * (OUTER**2 - INNER**2), 0.25 * np.pi * (OUTER**4 - INNER**4)
    bent = force * LENGTH**3 / (3.0 * MODULUS * second_moment)
    shear_modulus = MODULUS / (2.0 * (1.0 + POISSON))
    sheared = force * LENGTH / (cowper(INNER / OUTER) * shear_modulus * area)
    assert sheared > 0.3 * bent
    assert moved == pytest.approx(bent + sheared, rel=0.005)


def test_elastic_forces_are_minus_the_gradient_of_the_energy(small: ArmParameters) -> None:
    segments = tuple(replace(s, memory=NOTHING_REMEMBERED, shear=0.8) for s in small.segments)
    own = replace(small, segments=segments)
    joints = build(own).joints
    table = tabulate(own, joints)
    rng = np.random.default_rng(5)
    slides = 1e-3 * rng.normal(size=(len(joints), 3))
    turns = 0.1 * rng.normal(size=(len(joints), 3))
    rest = [rest_stiffness(own.segments[joint.segment], joint) for joint in joints]

    def energy(slides: Floats, turns: Floats) -> Floats:
        """Return the energy of each joint [J]: E A l (stretch^2 + stretch^-2) / 8 by fibre; shear, twist."""
        x, y = table.fibres[:, :, 0], table.fibres[:, :, 1]
        bent = turns[:, 0, None] * y - turns[:, 1, None] * x
        stretch = 1.0 + (slides[:, 2, None] + bent) / table.lengths[:, None]
        axial = (table.forces * (stretch**2 + stretch**-2.0) / 8.0).sum(axis=1) * table.lengths
        shear = np.array([one.shear for one in rest]) * (slides[:, :2] ** 2).sum(axis=1)
        twist = np.array([one.torsion for one in rest]) * turns[:, 2] ** 2
        return np.asarray(axial + 0.5 * (shear + twist))

    def turned(by: Floats) -> Floats:
        """Return the rotation vectors after a small turn in the link's frame."""
        quaternions = product(quaternions_of(turns), quaternions_of(by))
        sine = np.linalg.norm(quaternions[:, 1:], axis=1, keepdims=True)
        return np.asarray(2.0 * np.arctan2(sine, quaternions[:, :1]) / sine * quaternions[:, 1:])

    forces = joint_forces(
        table, fresh_memory(table), (slides, quaternions_of(turns)),
        np.zeros((len(joints), 3)), np.zeros(3), 1.0, False,
    )  # fmt: skip
    small_step = 1e-6
    for axis in range(3):
        step = small_step * np.tile(np.eye(3)[axis], (len(joints), 1))
        by_slide = energy(slides + step, turns) - energy(slides - step, turns)
        by_turn = energy(slides, turned(step)) - energy(slides, turned(-step))
        np.testing.assert_allclose(forces[:, axis], -by_slide / (2.0 * small_step), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(forces[:, 3 + axis], -by_turn / (2.0 * small_step), rtol=1e-5, atol=1e-7)


def test_shear_does_not_change_how_the_arm_hangs(small: ArmParameters, make_arm: MakeArm) -> None:
    soft = replace(small, segments=tuple(replace(s, shear=0.5) for s in small.segments))
    hanging, softer = make_arm().state, make_arm(parameters=soft).state
    np.testing.assert_allclose(softer.positions, hanging.positions, atol=1e-12)
    pulled = PlantInputs(np.zeros(6), hand=Hand("intermediate", force=(1.0, 0.0, 0.0)))
    further = [hold(make_arm(parameters=own), pulled, 2.0).positions[1, 0] for own in (soft, small)]
    assert further[0] > 1.02 * further[1]


@pytest.mark.parametrize("effect", ["tip_payload", "base_compliance"])
def test_an_effect_that_is_switched_keeps_the_shear_motion(effect: str, make_arm: MakeArm) -> None:
    pulled = PlantInputs(np.zeros(6), hand=Hand("intermediate", force=(2.0, 1.0, 0.0)))
    arm, twin = make_arm(), make_arm()
    for one in (arm, twin):
        hold(one, pulled, 0.15)
    arm.switch(effect, 1e-6)
    step = arm.parameters.step
    moved = [hold(one, pulled, step).positions for one in (arm, twin)]
    np.testing.assert_allclose(moved[0], moved[1], atol=1e-6)
    np.testing.assert_allclose(
        arm._data.qpos[arm._chain.slide_positions], twin._data.qpos[twin._chain.slide_positions], atol=1e-7
    )
    assert np.abs(twin._data.qpos[twin._chain.slide_positions][:, :2]).max() > 1e-4


def test_a_blow_across_the_arm_dies_out_at_the_default_step() -> None:
    arm = FakeArm(sopra())
    hold(arm, PlantInputs(np.zeros(6), hand=Hand("intermediate", force=(20.0, 0.0, 0.0))), 0.02)
    struck = arm.energy
    hold(arm, VENTED, 0.5)
    assert arm.energy < 0.5 * struck
    hold(arm, VENTED, 8.0)
    assert arm.energy < 1e-6


def test_arms_differ_in_their_shear_within_the_tolerance() -> None:
    shears = np.array([[s.shear for s in variant(seed).arm.segments] for seed in range(20)])
    assert np.all(np.abs(shears - 1.0) <= SHEAR_TOLERANCE)
    assert np.ptp(shears) > SHEAR_TOLERANCE
    assert {s.shear for s in variant(1, spread=0.0).arm.segments} == {1.0}

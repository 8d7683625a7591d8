"""The chain of links against what is known of a uniform elastic rod, and its derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.model import Inputs, Load
from softarm.estimator.response import BatchInputs
from softarm.estimator.rod.laws import FARTHEST, evaluate_laws, feature_slopes, features, term_table
from softarm.estimator.rod.skin import skin
from softarm.estimator.rod.statics import place, strain_between
from softarm.estimator.rotations import exp, log
from tests.estimator.derivatives import derivative_error
from tests.estimator.rod import linear_rod as known
from tests.estimator.rod.linear_rod import linear_rod

STILL = np.zeros(3)
HANGING = np.array([0.0, 0.0, 9.81])
RANDOM = np.random.default_rng(5)


def tip(rod, inputs):
    state, found = rod.solve(inputs, rod.rest())
    assert found
    step = rod.linearise(state, inputs)
    return step.frames.positions[-1], log(step.frames.rotations[-1] @ rod.chain.section_rotation[-1].T), state


def load(kind, axis, name="it"):
    return Load(name, kind, axis, section="tip")


def test_placing_links_and_taking_them_apart_are_inverse() -> None:
    lengths = RANDOM.uniform(0.02, 0.05, 5)
    strain = RANDOM.normal(size=(5, 6)) * [0.4, 0.4, 0.4, 0.002, 0.002, 0.002]
    rotations, positions, middles = np.zeros((6, 3, 3)), np.zeros((6, 3)), np.zeros((5, 3, 3))
    rotations[0] = exp(np.array([0.3, -0.2, 0.5]))
    place(strain, lengths, rotations, positions, middles)
    found = np.zeros((5, 6))
    strain_between(rotations, positions, lengths, found, np.zeros((5, 3, 3)))
    assert np.allclose(found, strain, atol=1e-12)


def test_a_share_more_of_a_compliance_is_a_share_more_of_its_strain() -> None:
    force, moment = 0.5, 0.01
    rod = linear_rod(8).with_loads([load("force", (0.0, 0.0, 1.0)), load("moment", (0.0, 0.0, 1.0))])
    rod = rod.with_compliances({"upper": 0.2, "lower": 0.2}, {"upper": 0.5})
    end, turn, _ = tip(rod, Inputs(np.zeros(6), np.array([force, moment]), STILL))
    longer = end[2] - rod.chain.section_offset[-1, 2] - known.LENGTH
    assert longer == pytest.approx(force * known.LENGTH / known.STRETCH * (1.5 + 1.0) / 2.0, rel=1e-2)
    assert turn[2] == pytest.approx(1.2 * moment * known.LENGTH / known.TORSION, rel=1e-4)


def test_a_moment_bends_the_rod_to_an_arc() -> None:
    moment = 0.2
    rod = linear_rod(32).with_loads([load("moment", (0.0, 1.0, 0.0))])
    place_, turn, _ = tip(rod, Inputs(np.zeros(6), np.array([moment]), STILL))
    angle = moment * known.LENGTH / known.BENDING
    assert turn == pytest.approx([0.0, angle, 0.0], abs=1e-9)
    radius = known.BENDING / moment
    arc = np.array([radius * (1.0 - np.cos(angle)), 0.0, radius * np.sin(angle)])
    end = place_ - exp(turn) @ rod.chain.section_offset[-1]
    assert np.linalg.norm(end - arc) < 2e-4 * known.LENGTH


def test_a_small_lateral_force_bends_it_as_a_beam() -> None:
    force = 1e-4
    rod = linear_rod(8).with_loads([Load("it", "force", (1.0, 0.0, 0.0), height=known.LENGTH)])
    _, turn, state = tip(rod, Inputs(np.zeros(6), np.array([force]), STILL))
    assert turn[1] == pytest.approx(force * known.LENGTH**2 / (2 * known.BENDING), rel=1e-6)
    across = force * known.LENGTH**3 / (3 * known.BENDING) + force * known.LENGTH / known.SHEAR
    assert rod.chain.station_frames(state).positions[-1, 0] == pytest.approx(across, rel=1e-4)


def test_more_links_converge_with_order_two() -> None:
    inputs = Inputs(np.zeros(6), np.array([0.0, 0.0, 0.5, 0.1]), HANGING)
    found = [tip(linear_rod(links), inputs)[0] for links in (4, 8, 16, 64)]
    errors = [float(np.linalg.norm(there - found[-1])) for there in found[:-1]]
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


def test_a_load_is_the_same_on_either_side_of_a_station() -> None:
    rod = linear_rod(8)
    height = float(rod.chain.heights[3])
    turned = []
    for gap in (-1e-7, 1e-7):
        pushed = rod.with_loads([Load("push", "force", (1.0, 0.0, 0.0), height=height + gap)])
        turned.append(tip(pushed, Inputs(np.zeros(6), np.array([1.0]), HANGING))[1])
    # Inside its link a load counts by its rest length, beyond it by the bent one.
    assert turned[0] == pytest.approx(turned[1], rel=5e-3)


def test_motion_is_the_derivative_by_pressures_and_loads() -> None:
    rod = linear_rod(8, curl=0.05, quadratic=1e-3)
    vector = np.concatenate([RANDOM.uniform(0.0, 5e4, 6), RANDOM.normal(size=4) * 0.1])
    begin = rod.solve(Inputs(vector[:6], vector[6:], HANGING), rod.rest())[0]
    step = rod.linearise(begin, Inputs(vector[:6], vector[6:], HANGING))

    def twists(values):
        state, found = rod.solve(Inputs(values[:6], values[6:], HANGING), begin)
        assert found
        frames = rod.linearise(state, Inputs(values[:6], values[6:], HANGING)).frames
        turned = log(frames.rotations @ np.swapaxes(step.frames.rotations, -1, -2))
        return np.concatenate([frames.positions, turned], axis=1).ravel()

    steps = np.array([100.0] * 6 + [1e-3] * 4)
    assert derivative_error(twists, step.motion, vector, steps) < 1e-5


def test_the_frames_of_a_state_in_equilibrium_are_those_of_the_linearisation() -> None:
    rod = linear_rod(8, curl=0.05, quadratic=1e-3)
    inputs = Inputs(np.linspace(0.0, 5e4, 6), np.full(4, 0.1), HANGING)
    state, found = rod.solve(inputs, rod.rest())
    assert found
    frames, expected = rod.section_frames(state), rod.linearise(state, inputs).frames
    np.testing.assert_allclose(frames.positions, expected.positions, atol=1e-9)
    np.testing.assert_allclose(frames.rotations, expected.rotations, atol=1e-9)


def test_a_batch_may_be_empty() -> None:
    rod = linear_rod(8, curl=0.05, quadratic=1e-3, scaled=True)
    batch = rod.evaluate(BatchInputs(np.zeros((0, 6)), np.zeros((0, 4)), np.zeros((0, 3))))
    assert batch.frames.positions.shape[0] == 0
    assert batch.eigenstrain_jacobian.shape[0] == 0


def test_a_batch_gives_single_answers_and_derivatives_by_gravity_and_stiffness() -> None:
    rod = linear_rod(8, curl=0.05, quadratic=1e-3, scaled=True).with_scales({"upper": 1.3, "lower": 0.8})
    pressures, loads = RANDOM.uniform(0.0, 5e4, (5, 6)), RANDOM.normal(size=(5, 4)) * 0.1
    gravity = RANDOM.normal(size=(5, 3)) * 5.0
    batch = rod.evaluate(BatchInputs(pressures, loads, gravity))
    assert batch.converged.all()
    for k in range(5):
        state, _ = rod.solve(Inputs(pressures[k], loads[k], gravity[k]), rod.rest())
        step = rod.linearise(state, Inputs(pressures[k], loads[k], gravity[k]))
        assert np.allclose(batch.frames.positions[k], step.frames.positions, atol=1e-9)
        assert np.allclose(batch.input_jacobian[k][:, :10], step.motion, rtol=1e-4, atol=1e-7)

    def twists(values):
        scaled = rod.with_scales(dict(zip(rod.regions, values[3:], strict=True)))
        frames = scaled.evaluate(BatchInputs(pressures[:1], loads[:1], values[:3])).frames
        turned = log(frames.rotations[0] @ np.swapaxes(batch.frames.rotations[0], -1, -2))
        return np.concatenate([frames.positions[0], turned], axis=1).ravel()

    point = np.concatenate([gravity[0], [1.3, 0.8]])
    by_factor = batch.factor_jacobian[0] / point[3:]
    jacobian = np.hstack([batch.gravity_jacobian[0], by_factor])
    assert derivative_error(twists, jacobian, point, 1e-3) < 1e-5


def test_scaling_stiffness_and_loads_alike_changes_nothing() -> None:
    rod = linear_rod(8, curl=0.05, quadratic=1e-3)
    inputs = Inputs(RANDOM.uniform(0.0, 5e4, 6), RANDOM.normal(size=4) * 0.1, HANGING)
    scaled = rod.with_scales(dict.fromkeys(rod.regions, 1.7))
    more = Inputs(1.7 * inputs.pressures, 1.7 * inputs.loads, 1.7 * inputs.gravity)
    assert np.allclose(tip(rod, inputs)[0], tip(scaled, more)[0], atol=1e-9)
    with pytest.raises(InputError, match="no region 'middle'"):
        rod.with_scales({"middle": 1.1})


def test_loads_off_the_arm_are_refused() -> None:
    rod = linear_rod(8)
    with pytest.raises(InputError, match="outside the arm"):
        _ = rod.with_loads([Load("far", "force", (1.0, 0.0, 0.0), height=1.0)])._compiled
    with pytest.raises(InputError, match="no section 'elbow'"):
        _ = rod.with_loads([Load("far", "force", (1.0, 0.0, 0.0), section="elbow")])._compiled


def test_slopes_of_the_terms_are_their_derivatives() -> None:
    table = term_table(6, 3)
    point, direction = RANDOM.normal(size=(1, 9)), RANDOM.normal(size=(1, 9))
    claimed = feature_slopes(table, point, direction)[0][:, None]
    error = derivative_error(
        lambda t: features(table, point + t * direction)[0], claimed, np.zeros(1), steps=1e-3
    )
    assert error < 1e-8


def law(rod, variables):
    """The strains of the first link and their derivatives, at wrenches and pressures over their units."""
    laws = rod.laws
    inputs = np.tile(variables, (rod.chain.links, 1)) * laws.scale * rod.factors[0]
    value, slopes = np.empty((rod.chain.links, 8)), np.empty((rod.chain.links, 11, 8))
    evaluate_laws(laws, np.ascontiguousarray(inputs[:, :6]), np.tile(inputs[0, 6:], 2), value, slopes)
    return value[0, :6], slopes[0, 1:10, :6]


def curved_rod():
    return linear_rod(8, curl=0.05, quadratic=0.01, scaled=True).with_scales({"upper": 1.3, "lower": 1.3})


def within_reach(rod):
    """The rod, of laws that were fitted up to one unit of each wrench and pressure."""
    return replace(rod, laws=rod.laws._replace(reach=rod.laws.scale.copy()))


def test_a_law_goes_on_in_proportion_far_beyond_its_fit() -> None:
    unlimited = curved_rod()
    rod = within_reach(unlimited)
    border = FARTHEST * np.array([0.3, -0.2, 0.9, -1.0, 0.5, 0.1, 0.4, 0.7, 0.2])
    assert np.allclose(law(rod, 0.99 * border)[0], law(unlimited, 0.99 * border)[0], rtol=1e-12)
    at_border = law(unlimited, border)[0]
    assert np.allclose(law(rod, 2.5 * border)[0], 2.5 * at_border, rtol=1e-12)
    assert not np.allclose(law(unlimited, 2.5 * border)[0], 2.5 * at_border, rtol=0.1)


@pytest.mark.parametrize("size", [0.9, 1.7])
def test_slopes_of_a_law_are_its_derivatives_on_both_sides_of_the_border(size: float) -> None:
    rod = within_reach(curved_rod())
    point = size * FARTHEST * np.array([0.3, -0.2, 0.9, -1.0, 0.5, 0.1, 0.4, 0.7, 0.2])
    claimed = law(rod, point)[1].T
    assert derivative_error(lambda v: law(rod, v)[0], claimed, point, steps=1e-5) < 1e-7


def test_the_skin_of_a_rod_at_rest_is_the_body_and_follows_its_end() -> None:
    rod = linear_rod(8)
    points = RANDOM.uniform([-0.02, -0.02, 0.0], [0.02, 0.02, known.LENGTH], (50, 3))
    assert np.allclose(skin(points, rod.chain, rod.rest()), points, atol=1e-12)
    bent = replace(rod, chain=rod.chain)
    state, _ = bent.solve(Inputs(np.zeros(6), np.array([0.0, 0.0, 0.4, 0.0]), HANGING), rod.rest())
    frames = rod.chain.station_frames(state)
    end = np.array([[0.01, 0.0, known.LENGTH]])
    there = frames.positions[-1] + frames.rotations[-1] @ np.array([0.01, 0.0, 0.0])
    assert np.allclose(skin(end, rod.chain, state)[0], there, atol=1e-12)

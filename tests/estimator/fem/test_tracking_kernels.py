"""The single-precision kernels of tracking compute what the plain path does in double precision."""

import pickle
from collections.abc import Callable

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.linalg.cholesky import CholeskyFactor
from softarm.estimator.fem.tracking import TrackingModel
from softarm.estimator.fem.tracking.rotation_strain import SingleRotationStrain
from softarm.estimator.fem.tracking.single_factor import SingleFactor
from softarm.estimator.model import Inputs
from softarm.estimator.rotations import exp

WIDTH = 0.04
ArmOf = Callable[..., FiniteElementModel]


def _bent(arm: FiniteElementModel) -> Floats:
    inputs = Inputs(np.array([6e3]), np.array([0.04, -0.02, 0.01]), np.array([0.0, 0.0, 9.81]))
    state, converged = arm.solve(inputs, arm.rest())
    assert converged
    return state.displacement


def _close(single: Floats, double: Floats, tolerance: float = 1e-4) -> None:
    assert np.abs(double).max() > 0.0
    assert np.abs(single - double).max() < tolerance * np.abs(double).max()


@pytest.mark.parametrize("kind", ["tet4", "hex8", "hex20"])
def test_each_operation_agrees_with_the_plain_path(arm_of: ArmOf, kind: str) -> None:
    arm = arm_of(kind)
    plain, single = arm.body.rotation_strain, SingleRotationStrain.of(arm.body)
    bent, still = _bent(arm), np.zeros_like(arm.body.points)
    rng = np.random.default_rng(5)
    step = arm.body.pattern.scatter(1e-3 * rng.standard_normal(3 * arm.body.pattern.free))
    rotations = [path.rotations(path.deformation(still), path.deformation(bent)) for path in (plain, single)]
    _close(single.solve_poisson(step), plain.solve_poisson(step))
    _close(single.corotated_divergence(rotations[1], step), plain.corotated_divergence(rotations[0], step))
    _close(single.pulled_back(rotations[1], step), plain.pulled_back(rotations[0], step))
    moved = [
        path.moved(bent, path.deformation(bent), step, turned)
        for path, turned in zip((plain, single), rotations, strict=True)
    ]
    _close(moved[1] - bent, moved[0] - bent)


def test_pulling_forces_back_is_the_adjoint_of_carrying(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    plain, rng = arm.body.rotation_strain, np.random.default_rng(8)
    rotations = plain.rotations(plain.deformation(0.0 * arm.body.points), plain.deformation(_bent(arm)))
    forces, step = (arm.body.pattern.scatter(rng.standard_normal(3 * arm.body.pattern.free)) for _ in "ab")
    carried = plain.solve_poisson(plain.corotated_divergence(rotations, step))
    assert (forces * carried).sum() == pytest.approx((plain.pulled_back(rotations, forces) * step).sum())


def test_twists_are_read_off_the_divergence(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    tracking = TrackingModel(arm)
    divergence = np.random.default_rng(4).standard_normal(arm.body.points.shape)
    assembled = arm.body.rotation_strain.solve_poisson(divergence)
    _close(tracking.moments_of_divergence @ divergence, arm.section_fit.weights @ assembled)


def test_a_single_factor_keeps_single_precision(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    step = arm.linearise(arm.rest(), arm.no_inputs())
    assert step.factor is not None
    assert isinstance(step.factor.symmetric, CholeskyFactor)
    forces, single = step.input_forces(), SingleFactor.of(step.factor.symmetric)
    exact, rough = step.factor.solve(forces), single.solve(forces)
    for one, other in zip(exact, rough, strict=True):
        assert np.linalg.norm(other - one) < 1e-3 * np.linalg.norm(one)
    assert np.array_equal(single.solve(forces[0]), rough[0])


@pytest.mark.parametrize("kind", ["tet4", "hex20"])
def test_points_rotate_with_the_material(arm_of: ArmOf, kind: str) -> None:
    arm = arm_of(kind)
    rng = np.random.default_rng(6)
    rotation = exp(np.array([0.7, -0.4, 1.1]))
    stretch = np.eye(3) + 0.1 * (rng.random((3, 3)) - 0.5)
    stretch = 0.5 * (stretch + stretch.T)
    strained = arm.body.points @ (rotation @ stretch - np.eye(3)).T
    plain, single = arm.body.rotation_strain, SingleRotationStrain.of(arm.body)
    still = np.zeros_like(strained)
    double = plain.rotations(plain.deformation(still), plain.deformation(strained))
    assert np.abs(double - rotation).max() < 1e-12
    fast = single.rotations(single.deformation(still), single.deformation(strained))
    assert np.abs(fast - rotation.reshape(1, 9, 1)).max() < 1e-5


def test_a_step_that_bends_the_body_stretches_it_less_than_a_straight_one(arm_of: ArmOf) -> None:
    arm = arm_of("hex20", layers=6)
    x, z = arm.body.points[:, 0] - WIDTH / 2, arm.body.points[:, 2]
    step = 3.0 * np.column_stack([0.5 * z**2, 0.0 * z, -x * z])
    plain, still = arm.body.rotation_strain, np.zeros_like(step)
    moved = plain.moved(still, plain.deformation(still), step)
    strains = []
    for displacement in (step, moved):
        field = plain.deformation(displacement)
        strains.append(float(np.sqrt(np.mean((field.swapaxes(1, 2) @ field - np.eye(3)) ** 2))))
    bending = 2.0 * 3.0 * float(np.sqrt(np.mean(x**2))) / 3.0
    assert strains[1] < 1.2 * bending < strains[0]


def test_a_model_that_was_solved_goes_to_another_process(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    bent = _bent(arm)
    sent = pickle.loads(pickle.dumps(arm))
    assert np.array_equal(_bent(sent), bent)

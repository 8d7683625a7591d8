"""The short cuts of a tracking step give what the plain ways give."""

from collections.abc import Callable

import numpy as np
import pytest

from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.lanes import SINGLE_LANES
from softarm.estimator.fem.section_fit import build_section_fit
from softarm.estimator.fem.sections import Section, build_section
from softarm.estimator.model import Inputs
from softarm.estimator.rotations import exp

WIDTH = 0.04
ArmOf = Callable[..., FiniteElementModel]


def _bent(arm: FiniteElementModel) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    inputs = Inputs(np.array([6e3]), np.array([0.04, -0.02, 0.01]), np.array([0.0, 0.0, 9.81]))
    found, converged = arm.solve(inputs, arm.rest())
    assert converged
    return found.displacement


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_all_sections_at_once_fit_as_each_alone(arm_of: ArmOf, kind: str) -> None:
    arm = arm_of(kind)
    displacement = _bent(arm)
    frames = (*arm.frames.values(), build_section(arm.mesh, Section("skin", point=(0.002, 0.003, 0.06))))
    fit = build_section_fit(frames, len(arm.mesh.points), arm.body.transport)
    fitted = fit.at(arm.body.points + displacement)
    poses = [frame.at(arm.body.points + displacement) for frame in frames]
    for k, pose in enumerate(poses):
        assert np.allclose(fitted.frames.positions[k], pose.position, atol=1e-12)
        assert np.allclose(fitted.frames.rotations[k], pose.rotation, atol=1e-12)
    moves = np.random.default_rng(3).standard_normal((2, *displacement.shape))
    twists = fitted.twists(fit.weights @ moves)
    for move, twist in zip(moves, twists, strict=True):
        expected = np.concatenate([pose.push(move) for pose in poses])
        assert np.allclose(twist, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_twists_are_read_off_the_divergence(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    transport, fit = arm.body.transport, arm.section_fit
    shape = (transport.groups, 9, SINGLE_LANES)
    fields = np.random.default_rng(4).standard_normal(shape).astype(np.float32)
    expected = fit.weights @ transport.assemble(fields)
    read = fit.of_divergence @ transport.divergence(fields)
    assert np.abs(read - expected).max() < 1e-4 * np.abs(expected).max()


def test_a_compact_factor_keeps_single_precision(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    step = arm.linearise(arm.rest(), arm.no_inputs())
    assert step.factor is not None
    forces = step.input_forces()
    exact, rough = step.factor.solve(forces), step.factor.compact().solve(forces)
    for one, other in zip(exact, rough, strict=True):
        assert np.linalg.norm(other - one) < 1e-3 * np.linalg.norm(one)
    assert np.array_equal(step.factor.compact().solve(forces[0]), rough[0])


def test_vectors_are_solved_for_as_each_component_alone(arm_of: ArmOf) -> None:
    transport = arm_of("hex20").body.transport
    right = np.random.default_rng(5).standard_normal((len(transport.pattern.place), 3))
    solved = np.ones_like(right)
    transport.factor.add_vectors(right, transport.pattern.free_nodes, solved)
    expected = 1.0 + transport.solve_poisson(np.ascontiguousarray(right.T)).T
    assert np.abs(solved - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("kind", ["tet4", "hex20"])
def test_points_turn_with_the_material(arm_of: ArmOf, kind: str) -> None:
    arm = arm_of(kind)
    transport, rng = arm.body.transport, np.random.default_rng(6)
    rotation = exp(np.array([0.7, -0.4, 1.1]))
    stretch = np.eye(3) + 0.1 * (rng.random((3, 3)) - 0.5)
    stretch = 0.5 * (stretch + stretch.T)
    before = transport.deformation(0.01 * arm.body.points @ rng.random((3, 3)).T)
    after = transport.deformation(arm.body.points @ (rotation @ stretch - np.eye(3)).T)
    rest = transport.deformation(np.zeros_like(arm.body.points))
    turns = transport.turns(transport.inverse(rest), after)
    assert np.abs(turns - rotation.reshape(1, 9, 1)).max() < 1e-5
    round_trip = np.einsum("gikl,gkjl->gijl", *(_square(f) for f in (before, transport.inverse(before))))
    assert np.abs(round_trip - np.eye(3)[:, :, None]).max() < 1e-5


def test_a_step_that_bends_the_body_stretches_it_less_than_a_straight_one(arm_of: ArmOf) -> None:
    arm = arm_of("hex20", layers=6)
    x, z = arm.body.points[:, 0] - WIDTH / 2, arm.body.points[:, 2]
    step = 3.0 * np.column_stack([0.5 * z**2, 0.0 * z, -x * z])
    transport, still = arm.body.transport, np.zeros_like(step)
    moved = transport.moved(still, transport.deformation(still), step)
    strains = []
    for displacement in (step, moved):
        field = _square(transport.deformation(displacement))
        stretch = np.einsum("gkil,gkjl->gijl", field, field) - np.eye(3)[:, :, None]
        strains.append(float(np.sqrt(np.mean(stretch**2))))
    bending = 2.0 * 3.0 * float(np.sqrt(np.mean(x**2))) / 3.0
    assert strains[1] < 1.2 * bending < strains[0]


def _square(
    field: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return field.reshape(len(field), 3, 3, -1)

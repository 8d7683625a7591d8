"""Frames of sections: rigid motions are recovered, and twists and forces are each other's adjoints."""

from collections.abc import Callable

import numpy as np
import pytest

from softarm.estimator.fem import FiniteElementModel, SectionNodes
from softarm.estimator.fem.sections import SectionFit, build_section, build_slice
from softarm.estimator.rotations import exp, log
from tests.estimator.derivatives import derivative_error

ArmOf = Callable[..., FiniteElementModel]


def _fit(arm: FiniteElementModel) -> SectionFit:
    skin = build_section(arm.mesh, SectionNodes("skin", point=(0.002, 0.003, 0.06)))
    frames = (*arm.frames.values(), build_slice(arm.mesh, 0.05), skin)
    return SectionFit.of(frames, len(arm.mesh.points))


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_a_rigid_motion_is_recovered(arm_of: ArmOf, kind: str) -> None:
    arm = arm_of(kind)
    rotation, shift = exp(np.array([0.3, -1.2, 2.0])), np.array([0.1, -0.2, 0.3])
    fit = _fit(arm)
    rest, moved = fit.at(arm.mesh.points).frames, fit.at(arm.mesh.points @ rotation.T + shift).frames
    assert np.allclose(moved.positions[:2], rest.positions[:2] @ rotation.T + shift, atol=1e-12)
    assert np.allclose(moved.rotations[:2], rotation @ rest.rotations[:2], atol=1e-12)
    assert np.array_equal(moved.rotations[2], np.eye(3))
    assert np.allclose(moved.positions[2], rotation @ [0.002, 0.003, 0.06] + shift, atol=1e-9)


def test_where_a_search_has_diverged_there_are_no_frames(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    poses = _fit(arm).at(np.full_like(arm.mesh.points, np.nan))
    assert np.isnan(poses.frames.positions).all()
    assert np.isnan(poses.frames.rotations[:2]).all()


def test_twists_are_the_derivative_of_the_frames(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    rng = np.random.default_rng(3)
    positions = arm.mesh.points + 2e-3 * rng.standard_normal(arm.mesh.points.shape)
    fit, moves = _fit(arm), rng.standard_normal((4, *positions.shape))
    here = fit.at(positions)

    def twist(amounts: np.ndarray) -> np.ndarray:
        there = fit.at(positions + np.tensordot(amounts, moves, 1)).frames
        spins = log(there.rotations @ here.frames.rotations.transpose(0, 2, 1))
        return np.concatenate([there.positions, spins], axis=1).ravel()

    assert derivative_error(twist, here.twists(moves).T, np.zeros(4), 1e-5) < 1e-6


def test_pulling_back_is_the_adjoint_of_the_twists(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    rng = np.random.default_rng(4)
    positions = arm.mesh.points + 1e-3 * rng.standard_normal(arm.mesh.points.shape)
    poses = _fit(arm).at(positions)
    rows, move = rng.standard_normal((5, 18)), rng.standard_normal((1, *positions.shape))
    pulled = np.tensordot(poses.pull_back(rows), move[0], 2)
    assert np.allclose(pulled, rows @ poses.twists(move)[0], rtol=1e-10, atol=1e-10)

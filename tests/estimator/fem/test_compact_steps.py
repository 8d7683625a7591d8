"""The short cuts of a tracking step give what the plain ways give."""

from collections.abc import Callable

import numpy as np
import pytest

from estimator.fem import FiniteElementModel
from estimator.fem.section_fit import build_section_fit
from estimator.fem.sections import Section, build_section
from estimator.model import Inputs

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
    fields = np.random.default_rng(4).standard_normal((transport.points, 3, 3))
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

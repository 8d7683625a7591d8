"""Every tangent and every Jacobian against finite differences."""

from collections.abc import Callable

import numpy as np
import pytest

from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.mesh import ElementKind
from softarm.estimator.model import Inputs
from tests.estimator.derivatives import central_difference

ArmOf = Callable[..., FiniteElementModel]

INPUTS = Inputs(np.array([2e4]), np.array([0.1, 0.0, 0.3]), np.array([0.0, 0.0, 9.81]))
CASES: list[tuple[ElementKind, str]] = [
    *(("tet4", law) for law in ("small", "corotational", "corotational_polar", "corotational_edge_polar")),
    *((kind, law) for kind in ("tet4", "tet10", "hex8", "hex20") for law in ("neo_hookean", "gent")),
    ("hex20", "yeoh"),
    ("hex20", "softening"),
]


@pytest.mark.parametrize(("kind", "law"), CASES)
def test_tangent_is_the_derivative_of_the_residual(kind: ElementKind, law: str, arm_of: ArmOf) -> None:
    arm = arm_of(kind, law)
    rng = np.random.default_rng(3)
    displacement = 5e-4 * rng.standard_normal(arm.body.points.shape)
    balance = arm.balance(displacement, INPUTS)
    tangent = balance.evaluation.tangent
    assert balance.evaluation.valid
    assert tangent is not None
    matrix = arm.body.pattern.matrix(tangent.values, tangent.mirror)
    direction = rng.standard_normal(matrix.shape[0])

    def residual(step: np.ndarray) -> np.ndarray:
        moved = displacement + arm.body.pattern.scatter(step[0] * direction)
        return arm.balance(moved, INPUTS, tangent=False).residual

    numeric = central_difference(residual, np.zeros(1), 1e-7)[:, 0]
    assert np.abs(numeric + matrix @ direction).max() < 1e-8 * np.abs(numeric).max()
    asymmetry = np.abs(matrix - matrix.T).max() / np.abs(matrix).max()
    assert (asymmetry < 1e-14) == arm.body.symmetric


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex20"])
@pytest.mark.parametrize("law", ["neo_hookean", "gent"])
def test_positions_that_are_not_numbers_are_invalid(kind: ElementKind, law: str, arm_of: ArmOf) -> None:
    body = arm_of(kind, law).body
    pressures, scales = np.zeros(body.chambers), np.ones(len(body.parameters))
    for node in np.unique([node for block in body.mesh_blocks for node in block.connectivity.ravel()]):
        positions = body.points.copy()
        positions[node] = np.nan
        assert not body.evaluate(positions, pressures, scales, tangent=False).valid, node


@pytest.mark.parametrize("kind", ["tet4", "hex20"])
def test_response_is_the_derivative_of_the_equilibrium(kind: ElementKind, arm_of: ArmOf) -> None:
    arm = arm_of(kind)
    start = arm.equilibrium(INPUTS).value
    step = arm.linearise(start, INPUTS)
    gap, response = step.response(np.eye(6))
    assert np.abs(gap).max() < 1e-8

    def twist(values: np.ndarray) -> np.ndarray:
        inputs = Inputs(values[:1] * 1e4, values[1:4], INPUTS.gravity)
        found = arm.equilibrium(inputs, start)
        assert found.converged
        frames = arm.section_frames(found.value)
        turn = frames.rotations[0] @ step.frames.rotations[0].T
        axial = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return np.concatenate([frames.positions[0], axial])

    point = np.concatenate([INPUTS.pressures / 1e4, INPUTS.loads])
    numeric = central_difference(twist, point, 2e-3)
    claimed = response * np.array([1e4, 1.0, 1.0, 1.0])
    assert np.abs(numeric - claimed).max() < 2e-4 * np.abs(numeric).max()


def test_response_to_stiffness_factors(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    start = arm.equilibrium(INPUTS).value
    step = arm.linearise(start, INPUTS)
    claimed = step.full_response(np.eye(6)[:3])[3]

    def position(scales: np.ndarray) -> np.ndarray:
        changed = arm.with_scales(dict(zip(arm.parameters, scales, strict=True)))
        return changed.section_frames(changed.equilibrium(INPUTS, start).value).positions[0]

    numeric = central_difference(position, np.ones(2), 1e-3)
    assert np.abs(numeric - claimed).max() < 1e-6 * np.abs(numeric).max()


def test_motions_predict_the_state_under_other_inputs_and_factors(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    start = arm.equilibrium(INPUTS).value
    step = arm.linearise(start, INPUTS)
    inputs = Inputs(1.1 * INPUTS.pressures, 0.9 * INPUTS.loads, INPUTS.gravity + np.eye(3)[0] * 0.5)
    changed = arm.with_scales(dict(zip(arm.parameters, [1.03, 0.96], strict=True)))
    change = [1.0, *0.1 * INPUTS.pressures, *-0.1 * INPUTS.loads, 0.5, 0.0, 0.0, 0.03, -0.04]
    predicted = changed.displace(start, np.tensordot(change, step.motions, 1), inputs)
    true = changed.equilibrium(inputs, start).value.displacement
    missed = np.abs(predicted.displacement - true).max()
    assert missed < 0.05 * np.abs(start.displacement - true).max()
    assert predicted.inputs is inputs


def test_advance_takes_the_newton_step(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    state = arm.rest()
    target = np.array([3e3, 0.02, 0.0, -0.05])
    norms = []
    for _ in range(6):
        step = arm.linearise(state, state.inputs)
        change = target - np.concatenate([state.inputs.pressures, state.inputs.loads])
        state = arm.advance(step, change)
        norms.append(arm.linearise(state, state.inputs).residual_norm)
    assert norms[-1] < 1e-9
    found = arm.equilibrium(Inputs(target[:1], target[1:], np.zeros(3)))
    assert np.abs(found.value.displacement - state.displacement).max() < 1e-9
    assert isinstance(found.value, FiniteElementState)

"""The factor against scipy's: solutions, indefinite matrices, and a continuation through a snap."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import splu

from acceptance.verification.box import box, mapped, with_nodes
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import DistributedLoad, FiniteElementModel, Material, SolveStatus
from softarm.estimator.fem.linalg.cholesky import CholeskyPlan, FactorPlan
from softarm.estimator.fem.linalg.pardiso import PardisoPlan
from softarm.estimator.fem.linalg.pattern import Tangent
from softarm.estimator.fem.linalg.symbolic import analyse
from softarm.estimator.model import Inputs

ArmOf = Callable[..., FiniteElementModel]
INPUTS = Inputs(np.array([1e4]), np.array([0.1, 0.0, 0.05]), np.array([0.0, 0.0, 9.81]))


def _plan(arm: FiniteElementModel, backend: str) -> FactorPlan:
    pattern = arm.body.pattern
    if backend == "cholesky":
        return FactorPlan(pattern, CholeskyPlan.of(analyse(pattern, arm.body.ordering)))
    pytest.importorskip("pypardiso")
    plan = PardisoPlan.of(pattern)
    assert plan is not None
    return FactorPlan(pattern, plan)


def _tangent(arm: FiniteElementModel) -> Tangent:
    solution = arm.equilibrium(INPUTS)
    assert solution.converged
    tangent = arm.balance(solution.value.displacement, INPUTS).evaluation.tangent
    assert tangent is not None
    return tangent


def _matrix(arm: FiniteElementModel, tangent: Tangent) -> sparse.csc_matrix:
    return arm.body.pattern.matrix(tangent.values, tangent.mirror)


def _error(found: Floats, expected: Floats) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("backend", ["cholesky", "pardiso"])
@pytest.mark.parametrize("kind", ["tet4", "hex8", "hex20"])
def test_solutions_are_those_of_superlu(arm_of: ArmOf, kind: str, backend: str) -> None:
    arm = arm_of(kind)
    tangent = _tangent(arm)
    factor = _plan(arm, backend).factorise(tangent)
    assert factor is not None
    right = np.random.default_rng(1).standard_normal((7, 3 * arm.body.pattern.free))
    expected = splu(_matrix(arm, tangent)).solve(right.T).T
    assert _error(factor.solve(right), expected) < 1e-9
    assert _error(factor.solve(right[0]), expected[0]) < 1e-9
    assert _error(factor.solve_transposed(right), expected) < 1e-9


@pytest.mark.parametrize("backend", ["cholesky", "pardiso"])
def test_an_unsymmetric_tangent_is_solved_exactly(arm_of: ArmOf, backend: str) -> None:
    arm = arm_of("tet4", "corotational")
    tangent = _tangent(arm)
    assert not tangent.symmetric
    factor = _plan(arm, backend).factorise(tangent)
    assert factor is not None
    right = np.random.default_rng(1).standard_normal((2, 3 * arm.body.pattern.free))
    superlu = splu(_matrix(arm, tangent))
    assert _error(factor.solve(right), superlu.solve(right.T).T) < 1e-7
    assert _error(factor.solve_transposed(right), superlu.solve(right.T, trans="T").T) < 1e-7


@pytest.mark.parametrize("backend", ["cholesky", "pardiso"])
def test_the_lowest_eigenvalue_decides_whether_there_is_a_factor(arm_of: ArmOf, backend: str) -> None:
    arm = arm_of("hex8")
    tangent, plan = _tangent(arm), _plan(arm, backend)
    least = float(np.linalg.eigvalsh(_matrix(arm, tangent).toarray())[0])
    assert least > 0.0
    diagonal = arm.body.pattern.column_start[:-1]
    for share, definite in ((0.99, True), (1.01, False)):
        shifted = tangent.values.copy()
        shifted[diagonal] -= share * least * np.eye(3)
        assert (plan.factorise(Tangent(shifted, shifted)) is not None) == definite


def test_pardiso_keeps_factors_apart(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    plan, tangent = _plan(arm, "pardiso"), _tangent(arm)
    right = np.random.default_rng(1).standard_normal(3 * arm.body.pattern.free)
    twice = Tangent(2.0 * tangent.values, 2.0 * tangent.values)
    first, second = plan.factorise(Tangent(tangent.values, tangent.values)), plan.factorise(twice)
    assert first is not None
    assert second is not None
    assert _error(2.0 * second.solve(right), first.solve(right)) < 1e-10
    del second
    third = plan.factorise(twice)
    assert third is not None
    assert _error(2.0 * third.solve(right), first.solve(right)) < 1e-10
    assert isinstance(plan.backend, PardisoPlan)
    assert not plan.backend.idle


def test_a_continuation_goes_through_a_snap() -> None:
    length, rise = 0.2, 0.015
    flat = box("hex20", (12, 1, 1), (length, 0.01, 0.006))
    arch = mapped(flat, lambda x: x + np.outer(rise * (1.0 - (2.0 * x[:, 0] / length - 1.0) ** 2), [0, 0, 1]))
    mesh = with_nodes(arch, "clamp", lambda x: (x[:, 0] < 1e-9) | (x[:, 0] > length - 1e-9))
    weight = DistributedLoad("down", "force", (0.0, 0.0, -1.0), region="body")
    model = FiniteElementModel.build(mesh, {"body": Material(young=300e3)}, loads=[weight])
    top = np.argmin(np.linalg.norm(mesh.points[:, :2] - [length / 2, 0.005], axis=1))
    heights, state = [], model.rest()
    for load in (0.02, 0.04, 0.06, 0.08, 0.1):
        solution = model.equilibrium(Inputs(np.zeros(0), np.array([load]), np.zeros(3)), state)
        assert solution.status is SolveStatus.CONVERGED
        state = solution.value
        heights.append(float(mesh.points[top, 2] + state.displacement[top, 2]))
        tangent = model.balance(state.displacement, state.inputs).evaluation.tangent
        assert tangent is not None
        assert (
            np.linalg.eigvalsh(model.body.pattern.matrix(tangent.values, tangent.mirror).toarray())[0] > 0.0
        )
    falls = -np.diff(heights)
    assert falls.max() > 0.5 * rise
    assert falls.max() > 5.0 * np.median(falls)
    assert heights[0] > 0.5 * rise
    assert heights[-1] < 0.0

"""How loads on rotating sections change as the body moves: what the finite-element tangent leaves out.

The nodal forces of a moment, and of a force off its section's middle, rotate with the section. In
equilibrium K dx = f dp + L dx holds with the derivative L of these forces by the displacement. They depend on
the nodes through the nine moments M of a section's best-fit frame alone (``SectionFit``), so that
L = D P with D their derivative by M and P that of M by the nodes, and (K - D P)^-1 follows from K^-1
(Woodbury).
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.linalg.cholesky import StiffnessFactor
from softarm.estimator.fem.sections import SectionFit

STEP = 1e-5
"""Rotation by which the forces are differentiated [rad]."""


def exact_moves(
    model: FiniteElementModel, factor: StiffnessFactor, displacement: Floats, loads: Floats, nodal: Floats
) -> Floats | None:
    """Solve (K - L) x = f.

    Args:
        model: The model.
        factor: Factor of its tangent K at the displacement.
        displacement: An equilibrium [m], shape (nodes, 3).
        loads: Load amplitudes there, shape (loads,).
        nodal: Forces f on the nodes per unit of each input, shape (inputs, nodes, 3).

    Returns:
        Displacements per unit of each input, shape (inputs, nodes, 3); None where the loads themselves make
        the arm unstable.
    """
    pattern = model.body.pattern
    positions = model.body.points + displacement
    acting = [(fit, loads[indices] @ rows) for indices, fit, rows in model.load_set.following]
    acting = [(fit, row) for fit, row in acting if row.any()]
    right = np.concatenate([nodal, *(_by_fit(fit, row, positions) for fit, row in acting)])
    moves = pattern.scatter(factor.solve(pattern.gather(right)))
    plain, bent = moves[: len(nodal)], moves[len(nodal) :]
    if not acting:
        return plain
    moments = [(fit.weights[1:] @ moves).reshape(len(moves), 9) for fit, _ in acting]
    by_move = np.concatenate(moments, axis=1)
    feedback = by_move[len(nodal) :].T
    # At an eigenvalue of 1 K - L is singular: the loads buckle the arm.
    if np.linalg.eigvals(feedback).real.max() >= 1.0:
        return None
    change = np.linalg.solve(np.eye(len(feedback)) - feedback, by_move[: len(nodal)].T)
    exact: Floats = plain + np.tensordot(change.T, bent, 1)
    return exact


def _by_fit(fit: SectionFit, row: Floats, positions: Floats) -> Floats:
    """Differentiate the nodal forces of a load by the moments M, shape (9, nodes, 3).

    Args:
        fit: The section.
        row: Force and moment on it, shape (6,).
        positions: Nodes [m], shape (nodes, 3).
    """
    moments = fit.weights @ positions
    size = STEP * float(np.linalg.norm(moments[1:]))
    slopes = np.empty((9, *moments.shape))
    for index in range(9):
        change = np.zeros_like(moments)
        change[1:].flat[index] = size
        ahead, behind = (
            fit.from_moments(moments + sign * change).moment_rows(row[None])[0] for sign in (1.0, -1.0)
        )
        slopes[index] = (ahead - behind) / (2.0 * size)
    nodal: Floats = fit.weights.T @ slopes
    return nodal

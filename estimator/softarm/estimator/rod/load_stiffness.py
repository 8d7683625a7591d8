"""How loads on turning sections change as the body moves: what the finite-element tangent leaves out.

The nodal forces of a moment, and of a force beside its section's middle, turn along with the section. In
equilibrium K dx = f dp + L dx holds with the derivative L of these forces by the displacement. They depend on
the nodes through the nine numbers A of a section's best-fit frame alone (``SectionFrame.at``), so that
L = D P with D their derivative by A and P that of A by the nodes, and (K - D P)^-1 follows from K^-1
(Woodbury).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.factor import StiffnessFactor
from softarm.estimator.fem.interpolation import node_map
from softarm.estimator.fem.sections import SectionFrame

Floats = NDArray[np.float64]

STEP = 1e-5
"""Turn by which the forces are differentiated [rad]."""


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
    acting = [(frame, loads[indices] @ rows) for indices, frame, rows in model.load_set.turning]
    acting = [(frame, row) for frame, row in acting if row.any()]
    turned = [_by_fit(frame, row, positions) for frame, row in acting]
    right = np.concatenate([nodal, *turned])
    moves = pattern.scatter(factor.solve(pattern.gather(right)))
    plain, bent = moves[: len(nodal)], moves[len(nodal) :]
    if not acting:
        return plain
    fits = np.concatenate([_fit_of(frame, moves) for frame, _ in acting], axis=1)
    feedback = fits[len(nodal) :].T
    if np.linalg.eigvals(feedback).real.max() >= 1.0:
        return None
    change = np.linalg.solve(np.eye(len(feedback)) - feedback, fits[: len(nodal)].T)
    exact: Floats = plain + np.tensordot(change.T, bent, 1)
    return exact


def _fit_of(frame: SectionFrame, moves: Floats) -> Floats:
    """Give the change of A = sum_s x_s c_s^T for displacements of the nodes, shape (moves, 9)."""
    on_points = np.array([frame.points.apply(move) for move in moves])
    return np.asarray(np.einsum("msk,sl->mkl", on_points, frame.arms).reshape(len(moves), 9))


def _by_fit(frame: SectionFrame, row: Floats, positions: Floats) -> Floats:
    """Differentiate the nodal forces of a load by A, shape (9, nodes, 3).

    Args:
        frame: The section.
        row: Force and moment on it, shape (6,).
        positions: Nodes [m], shape (nodes, 3).
    """
    current = frame.points.apply(positions)
    count = len(current)
    alone = replace(frame, points=node_map(np.arange(count)))
    # Points moved by M c_s change A by M C; a flat section has no more than two columns of it.
    inward = np.linalg.pinv(frame.arms.T @ frame.arms)
    size = STEP * float(np.linalg.norm(frame.arms.T @ frame.arms))
    spread = frame.points.matrix(len(positions)).T
    slopes = np.empty((9, len(positions), 3))
    for index in range(9):
        change = np.zeros((3, 3))
        change[divmod(index, 3)] = size
        move = frame.arms @ (change @ inward).T
        ahead, behind = (
            alone.at(current + sign * move).pull_back(row[None], count)[0] for sign in (1.0, -1.0)
        )
        slopes[index] = spread @ ((ahead - behind) / (2.0 * size))
    return slopes

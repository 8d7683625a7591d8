"""How loads on turning sections change as the body moves: what the finite-element tangent leaves out.

The nodal forces of a moment, and of a force beside its section's middle, turn along with the section. In
equilibrium K du = f dp + L du holds with the derivative L of these forces by the displacement.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.fem import FiniteElementModel
from estimator.fem.factor import StiffnessFactor
from estimator.fem.sections import SectionFrame

Floats = NDArray[np.float64]

STEP = 1e-5
"""Largest displacement of a node by which the forces are differentiated [m]."""
SWEEPS = 40
CLOSE = 1e-7


def exact_moves(
    model: FiniteElementModel, factor: StiffnessFactor, displacement: Floats, loads: Floats, nodal: Floats
) -> Floats | None:
    """Solve (K - L) x = f by iteration x' = K^-1 (f + L x).

    Args:
        model: The model.
        factor: Factor of its tangent K at the displacement.
        displacement: An equilibrium [m], shape (nodes, 3).
        loads: Load amplitudes there, shape (loads,).
        nodal: Forces f on the nodes per unit of each input, shape (inputs, nodes, 3).

    Returns:
        Displacements per unit of each input, shape (inputs, nodes, 3); None where they do not settle: there
        the loads themselves make the arm unstable.
    """
    pattern = model.body.pattern
    right = pattern.gather(nodal)
    moves = pattern.scatter(factor.solve(right))
    rows = _section_rows(model, loads)
    if not rows or not len(moves):
        return moves
    for _ in range(SWEEPS):
        turned = _turned_forces(model, displacement, rows, moves)
        after = pattern.scatter(factor.solve(right + pattern.gather(turned)))
        gap, size = np.abs(after - moves).max(), np.abs(after).max()
        moves = after
        if gap <= CLOSE * size:
            return moves
    return None


def _section_rows(model: FiniteElementModel, loads: Floats) -> list[tuple[SectionFrame, Floats]]:
    """Give the frames on which loads turn along, each with the force and moment on it, shape (6,)."""
    found = [(frame, loads[indices] @ rows) for indices, frame, rows in model.load_set.turning]
    return [(frame, row) for frame, row in found if row.any()]


def _turned_forces(
    model: FiniteElementModel, displacement: Floats, rows: list[tuple[SectionFrame, Floats]], moves: Floats
) -> Floats:
    """Differentiate the forces of the loads along displacements, shape (inputs, nodes, 3)."""
    positions = model.body.points + displacement
    turned = np.zeros_like(moves)
    for index, move in enumerate(moves):
        step = STEP / max(float(np.abs(move).max()), 1e-300)
        for frame, row in rows:
            ahead, behind = (
                frame.at(positions + sign * step * move).pull_back(row[None], len(positions))[0]
                for sign in (1.0, -1.0)
            )
            turned[index] += (ahead - behind) / (2.0 * step)
    return turned

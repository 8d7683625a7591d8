"""Newton's iteration with any degrees of freedom held, for problems that the arm's clamp cannot express."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from softarm.estimator.arrays import Floats
from softarm.estimator.fem import Material
from softarm.estimator.fem.assembly import Body, build_body
from softarm.estimator.mesh import Mesh
from softarm.estimator.shape_functions import quadrature, shape_functions

NOBODY = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class HeldResult:
    """One row of the verification table.

    Args:
        check: What was checked.
        case: Element, law or quantity.
        expected: Published or analytic value.
        found: Ours.
        error: Relative error, or the error itself where the expected value is zero.
        limit: Largest error that passes.
        source: Where the expected value comes from.
    """

    check: str
    case: str
    expected: float
    found: float
    error: float
    limit: float
    source: str

    @property
    def passed(self) -> bool:
        """Whether the error is within its limit."""
        return bool(self.error <= self.limit)


def free_body(mesh: Mesh, material: Material) -> Body:
    """Build a body that nothing holds, of one material."""
    return build_body(mesh, dict.fromkeys(mesh.regions, material), (), (), NOBODY)


def tangent_and_forces(body: Body, displacement: Floats) -> tuple[sparse.csc_matrix, Floats]:
    """Return the tangent matrix over the nodes in ascending order and the internal forces [N]."""
    evaluation = body.evaluate(
        body.points + displacement, np.zeros(body.chambers), np.ones(len(body.parameters))
    )
    if not evaluation.valid or evaluation.tangent is None:
        raise ArithmeticError("an element was inverted")
    matrix = body.pattern.matrix(evaluation.tangent.values, evaluation.tangent.mirror)
    order = (3 * body.pattern.place[:, None] + np.arange(3)).ravel()
    return matrix[order][:, order], evaluation.forces


def solve_held(
    body: Body,
    held: NDArray[np.bool_],
    prescribed: Callable[[float], Floats],
    force: Floats,
    steps: int = 1,
    tolerance: float = 1e-10,
) -> Floats:
    """Find the equilibrium under prescribed displacements and dead forces.

    Args:
        body: A body that nothing holds.
        held: Which components are prescribed, shape (nodes, 3).
        prescribed: Displacement at a fraction of the way, shape (nodes, 3); its held components count.
        force: Nodal forces at the end [N], shape (nodes, 3).
        steps: Equal steps of displacement and force.
        tolerance: Last correction over the largest displacement.

    Returns:
        The displacement [m], shape (nodes, 3).

    Raises:
        ArithmeticError: A step did not converge in 30 iterations, or inverted an element.
    """
    displacement = np.zeros_like(body.points)
    free = np.flatnonzero(~held.ravel())
    for step in range(1, steps + 1):
        fraction = step / steps
        jump = np.where(held, prescribed(fraction) - displacement, 0.0)
        for _ in range(30):
            matrix, internal = tangent_and_forces(body, displacement)
            residual = (fraction * force - internal).ravel() - matrix @ jump.ravel()
            change = jump.ravel().copy()
            change[free] = spsolve(matrix[free][:, free].tocsc(), residual[free], permc_spec="MMD_AT_PLUS_A")
            displacement = displacement + change.reshape(-1, 3)
            jump = np.zeros_like(displacement)
            if np.abs(change).max() <= tolerance * max(np.abs(displacement).max(), 1e-300):
                break
        else:
            raise ArithmeticError("the held problem did not converge")
    return displacement


def facet_forces(mesh: Mesh, surface: str, traction: Callable[[Floats, Floats], Floats]) -> Floats:
    """Integrate a traction over a surface at rest.

    Args:
        mesh: Mesh.
        surface: Its name.
        traction: Traction [Pa] from places and outward normals, both of shape (facets, points, 3).

    Returns:
        Nodal forces [N], shape (nodes, 3).
    """
    facets = mesh.surfaces[surface]
    places, weights = quadrature(facets.kind)
    values, slopes = shape_functions(facets.kind, places)
    corners = mesh.points[facets.facets]
    tangents = np.einsum("fni,qnk->fqik", corners, slopes)
    area = np.cross(tangents[..., 0], tangents[..., 1])
    measure = np.linalg.norm(area, axis=2)
    spot = np.einsum("fni,qn->fqi", corners, values)
    loads = traction(spot, area / measure[..., None]) * (measure * weights)[..., None]
    forces = np.zeros_like(mesh.points)
    np.add.at(forces, facets.facets, np.einsum("fqi,qn->fni", loads, values))
    return forces

"""Volumes of the closed chambers, exactly, with their first and second derivatives.

On every facet kind the enclosed volume is a cubic form of the nodes, V = sum c_abc det(x_a, x_b, x_c) over
the triples of a facet's nodes, so its gradient and Hessian are exact and the load stiffness symmetric.
"""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.linalg.pattern import Pattern, Slots
from softarm.estimator.mesh import Mesh
from softarm.estimator.shape_functions import volume_form


@dataclass(frozen=True)
class Cavities:
    """Chamber walls of one facet kind, ready for the kernel.

    Args:
        facets: Nodes of each wall facet, shape (facets, nodes).
        chamber: Chamber of each facet, shape (facets,).
        triples: Local nodes of each term of the cubic form, shape (terms, 3).
        coefficients: Its coefficients, signed so that volumes are positive, shape (terms,).
        centre: A point near each chamber, subtracted for accuracy [m], shape (chambers, 3).
        slots: Where the blocks of each facet go, shape (facets, nodes, nodes).
    """

    facets: Indices
    chamber: Indices
    triples: Indices
    coefficients: Floats
    centre: Floats
    slots: Slots

    def attach(self, pattern: Pattern) -> "Cavities":
        """Find where the blocks go in a pattern."""
        return replace(self, slots=pattern.locate(self.facets))

    def volumes(
        self,
        positions: Floats,
        pressures: Floats,
        volumes: Floats,
        gradients: Floats,
        values: Floats,
        tangent: bool,
    ) -> None:
        """Add volumes, their gradients and, where wanted, the load stiffness -p d2V/dx2.

        Args:
            positions: Current nodes [m], shape (nodes, 3).
            pressures: Gauge pressures [Pa], shape (chambers,).
            volumes: Added to [m3], shape (chambers,).
            gradients: dV/dx, added to [m2], shape (chambers, nodes, 3).
            values: Tangent blocks [N/m], added to, shape (slots, 3, 3).
            tangent: Whether to add the load stiffness.
        """
        cavity_volumes(
            positions, self.facets, self.chamber, self.triples, self.coefficients, self.centre, self.slots,
            pressures, volumes, gradients, values, tangent,
        )  # fmt: skip


def build_cavities(mesh: Mesh, chambers: tuple[str, ...]) -> tuple[Cavities, ...]:
    """Prepare the chambers, one group per facet kind, in the order of the pressures.

    Raises:
        InputError: A chamber has no wall or its wall is not closed.
    """
    for name in chambers:
        _check_closed(mesh, name)
    centres = np.array([mesh.points[np.unique(mesh.surfaces[name].facets)].mean(axis=0) for name in chambers])
    groups = []
    for kind in sorted({mesh.surfaces[name].kind for name in chambers}):
        same = [k for k, name in enumerate(chambers) if mesh.surfaces[name].kind == kind]
        facets = np.concatenate([mesh.surfaces[chambers[k]].facets for k in same])
        chamber = np.concatenate([np.full(len(mesh.surfaces[chambers[k]].facets), k) for k in same])
        triples, coefficients = volume_form(kind)
        count = facets.shape[1]
        slots = np.empty((0, count, count), dtype=np.int32)
        # Normals point into the chamber, so that the form gives its volume with the wrong sign.
        groups.append(Cavities(np.array(facets), chamber, triples, -coefficients, centres, slots))
    return tuple(groups)


def _check_closed(mesh: Mesh, name: str) -> None:
    surface = mesh.surfaces.get(name)
    if surface is None or not len(surface.facets):
        raise InputError(f"mesh: surface {name!r}", "the chamber has no wall", "name its facets in the mesh")
    count = 3 if surface.kind.startswith("tri") else 4
    corners = surface.facets[:, :count]
    directed = np.column_stack([corners.ravel(), np.roll(corners, -1, axis=1).ravel()])
    # On a closed surface of one orientation every edge is run once each way.
    edges, times = np.unique(directed, axis=0, return_counts=True)
    reverse = np.unique(directed[:, ::-1], axis=0)
    if (times > 1).any() or not np.array_equal(edges, reverse):
        raise InputError(
            f"mesh: surface {name!r}", "the chamber's wall is not closed and consistently oriented",
            "add the missing facets and orient them all out of the solid",
        )  # fmt: skip


@compiled
def cavity_volumes(  # noqa: C901 (one loop nest, compiled)
    positions: Floats,
    facets: Indices,
    chamber: Indices,
    triples: Indices,
    coefficients: Floats,
    centre: Floats,
    slots: Slots,
    pressures: Floats,
    volumes: Floats,
    gradients: Floats,
    values: Floats,
    tangent: bool,
) -> None:
    """Evaluate V = sum c det(x_a, x_b, x_c), dV/dx_a = c x_b x x_c and d2V/dx_a dx_b = -c [x_c]."""
    count = facets.shape[1]
    x = np.empty((count, 3))
    slope = np.empty((count, 3))
    axial = np.empty((count, count, 3))
    for f in range(facets.shape[0]):
        owner = chamber[f]
        for n in range(count):
            for i in range(3):
                x[n, i] = positions[facets[f, n], i] - centre[owner, i]
        slope[:] = 0.0
        if tangent:
            axial[:] = 0.0
        for t in range(triples.shape[0]):
            c = coefficients[t]
            # det is cyclic: each node of the triple takes the first place once.
            for shift in range(3):
                a, b, d = triples[t, shift], triples[t, (shift + 1) % 3], triples[t, (shift + 2) % 3]
                slope[a, 0] += c * (x[b, 1] * x[d, 2] - x[b, 2] * x[d, 1])
                slope[a, 1] += c * (x[b, 2] * x[d, 0] - x[b, 0] * x[d, 2])
                slope[a, 2] += c * (x[b, 0] * x[d, 1] - x[b, 1] * x[d, 0])
                if tangent:
                    for i in range(3):
                        axial[a, b, i] -= c * x[d, i]
                        axial[b, a, i] += c * x[d, i]
        for n in range(count):
            for i in range(3):
                gradients[owner, facets[f, n], i] += slope[n, i]
                volumes[owner] += slope[n, i] * x[n, i] / 3.0
        pressure = pressures[owner]
        if not tangent or pressure == 0.0:
            continue
        for a in range(count):
            for b in range(count):
                slot = slots[f, a, b]
                # A node has no block with itself, since det holds each node once; only the lower triangle is
                # stored.
                if slot >= 0 and a != b:
                    v0, v1, v2 = (
                        pressure * axial[a, b, 0],
                        pressure * axial[a, b, 1],
                        pressure * axial[a, b, 2],
                    )
                    values[slot, 0, 1] += v2
                    values[slot, 0, 2] -= v1
                    values[slot, 1, 0] -= v2
                    values[slot, 1, 2] += v0
                    values[slot, 2, 0] += v1
                    values[slot, 2, 1] -= v0

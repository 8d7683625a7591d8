"""External loads as nodal forces per unit of amplitude."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError, require_known
from softarm.estimator.fem.sections import SectionFit, SectionFrame, build_slice
from softarm.estimator.mesh import Mesh
from softarm.estimator.model import Load
from softarm.estimator.shape_functions import quadrature, shape_functions


@dataclass(frozen=True)
class DistributedLoad(Load):
    """A force spread evenly over a region's rest volume or a surface's rest area; the amplitude is its total.

    Args:
        region: Material region; exclusive with ``surface``.
        surface: Named surface.
        between: Heights [m] between which it acts; everywhere when left out.
    """

    region: str | None = None
    surface: str | None = None
    between: tuple[float, float] | None = None


@dataclass(frozen=True)
class LoadSet:
    """The model's loads.

    Args:
        loads: What they are.
        constant: Nodal forces per unit of amplitude, zero for those that rotate, shape (loads, nodes, 3).
        following: Frames whose loads' nodal forces follow the configuration, each with the loads' indices
            and their rows, shape (loads of the frame, 6).
    """

    loads: tuple[Load, ...]
    constant: Floats
    following: tuple[tuple[Indices, SectionFit, Floats], ...]

    def vectors(self, positions: Floats) -> Floats:
        """Compute the nodal forces per unit of amplitude, shape (loads, nodes, 3)."""
        if not self.following:
            return self.constant
        vectors = self.constant.copy()
        for indices, fit, rows in self.following:
            vectors[indices] = fit.at(positions).pull_back(rows)
        return vectors


def build_loads(mesh: Mesh, loads: tuple[Load, ...], sections: dict[str, SectionFrame]) -> LoadSet:
    """Prepare the loads.

    A force on a section acts at its origin, one at a height on the centre of the cross-section, spread evenly
    over it; a moment is conjugate to the rotation of the section or of the cross-section.

    Raises:
        InputError: A load names an unknown section, region or surface, no place at all, or a height outside.
    """
    constant = np.zeros((len(loads), len(mesh.points), 3))
    following: dict[int, tuple[list[int], SectionFit, list[Floats]]] = {}
    slices: dict[float, SectionFrame] = {}
    for index, load in enumerate(loads):
        direction = np.array(load.direction, dtype=float)
        if abs(np.linalg.norm(direction) - 1.0) > 1e-6:
            raise InputError(f"load {load.name!r}", "direction is not a unit vector", "normalise it")
        if isinstance(load, DistributedLoad):
            constant[index] = _share(mesh, load)[:, None] * direction
            continue
        frame = _frame_of(mesh, load, sections, slices)
        fit = SectionFit.of((frame,), len(mesh.points))
        row = np.zeros(6)
        row[slice(0, 3) if load.kind == "force" else slice(3, 6)] = direction
        # At the mean of its points a force acts alike on all of them, however the section rotates.
        if load.kind == "force" and np.allclose(frame.origin, frame.mean, atol=1e-12):
            constant[index] = fit.at(mesh.points).pull_back(row[None])[0]
        else:
            # By frame, so that a section's loads share one fit per evaluation.
            indices, _, rows = following.setdefault(id(frame), ([], fit, []))
            indices.append(index)
            rows.append(row)
    return LoadSet(loads, constant, tuple((np.array(i), f, np.array(r)) for i, f, r in following.values()))


def _frame_of(
    mesh: Mesh, load: Load, sections: dict[str, SectionFrame], slices: dict[float, SectionFrame]
) -> SectionFrame:
    if load.section is not None:
        require_known(f"load {load.name!r}", "section", load.section, sections)
        return sections[load.section]
    if load.height is None:
        raise InputError(f"load {load.name!r}", "it names neither a section nor a height", "give one of them")
    if load.height not in slices:
        slices[load.height] = build_slice(mesh, load.height)
    return slices[load.height]


def _share(mesh: Mesh, load: DistributedLoad) -> Floats:
    """Compute each node's share of a distributed load, summing to 1, shape (nodes,)."""
    share = np.zeros(len(mesh.points))
    for kind, nodes in _supports(mesh, load):
        places, weights = quadrature(kind)
        values, slopes = shape_functions(kind, places)
        corners = mesh.points[nodes]
        tangents = np.einsum("eni,qnk->eqik", corners, slopes)
        # The root of Gram's determinant is the volume of an element and the area of a facet alike.
        gram = np.linalg.det(np.einsum("eqik,eqil->eqkl", tangents, tangents))
        measure = np.sqrt(gram) * weights
        if load.between is not None:
            height = np.einsum("en,qn->eq", corners[..., 2], values)
            measure = np.where((height >= load.between[0]) & (height <= load.between[1]), measure, 0.0)
        np.add.at(share, nodes, np.einsum("eq,qn->en", measure, values))
    total = share.sum()
    if not total > 0.0:
        raise InputError(f"load {load.name!r}", "it acts on nothing", "name a region or surface of the mesh")
    return np.asarray(share / total)


def _supports(mesh: Mesh, load: DistributedLoad) -> list[tuple[str, Indices]]:
    """List the elements or facets, by kind, on which a distributed load acts."""
    if load.surface is not None:
        require_known(f"load {load.name!r}", "surface", load.surface, mesh.surfaces)
        surface = mesh.surfaces[load.surface]
        return [(surface.kind, surface.facets)]
    if load.region is None:
        return [(block.kind, block.connectivity) for block in mesh.blocks]
    require_known(f"load {load.name!r}", "region", load.region, mesh.regions)
    region = mesh.regions.index(load.region)
    return [(block.kind, block.connectivity[block.region == region]) for block in mesh.blocks]


def superpose(factors: Floats, fields: Floats) -> Floats:
    """Sum nodal fields, shape (fields, nodes, 3), each times its factor."""
    flat = fields.reshape(len(factors), fields.shape[1] * fields.shape[2])
    return np.asarray((factors @ flat).reshape(fields.shape[1:]))

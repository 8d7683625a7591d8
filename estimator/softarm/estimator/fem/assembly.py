"""The discretised body: every force term, assembled into a residual and a tangent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import require_known
from softarm.estimator.fem.elements.cavity import Cavities, build_cavities
from softarm.estimator.fem.elements.fibre import Bars, Membrane, build_membrane, merge_bars
from softarm.estimator.fem.elements.hyperelastic import Solids, build_solids
from softarm.estimator.fem.elements.material import Material
from softarm.estimator.fem.linalg.cholesky import FactorPlan
from softarm.estimator.fem.linalg.ordering import Ordering, adjacency, dissect
from softarm.estimator.fem.linalg.pattern import Pattern, Tangent, build_pattern, free_nodes
from softarm.estimator.fem.linalg.symbolic import analyse
from softarm.estimator.fem.parity.corotational import Tetrahedra, build_tetrahedra
from softarm.estimator.fem.parity.springs import Springs, build_springs
from softarm.estimator.fem.rotation_strain import RotationStrain
from softarm.estimator.mesh import ElementBlock, Mesh


@dataclass(frozen=True)
class AssembledForces:
    """Forces of the body at a configuration.

    Args:
        forces: Internal forces [N], shape (nodes, 3).
        volumes: Chamber volumes [m3], shape (chambers,).
        gradients: Their derivatives, the nodal forces per pascal [m2], shape (chambers, nodes, 3).
        tangent: Derivative of (internal - pressure forces), when it was requested.
        valid: False where an element is inverted or beyond its law's limit; then nothing else is.
    """

    forces: Floats
    volumes: Floats
    gradients: Floats
    tangent: Tangent | None
    valid: bool


@dataclass(frozen=True)
class Body:
    """Elements, fibres and chambers on one block pattern.

    Args:
        points: Rest positions [m], shape (nodes, 3).
        solids: Hyperelastic blocks.
        tetrahedra: Co-rotational blocks.
        bars: Fibres.
        cavities: Chamber walls.
        chambers: Number of chambers.
        plan: Where tangent blocks go, and how they are factored.
        ordering: Elimination tree of the free nodes.
        mesh_blocks: The elements as the mesh has them.
        parameters: Names of the stiffness factors: regions, then fibres.
    """

    points: Floats
    solids: tuple[Solids, ...]
    tetrahedra: tuple[Tetrahedra, ...]
    bars: tuple[Bars, ...]
    cavities: tuple[Cavities, ...]
    chambers: int
    plan: FactorPlan
    ordering: Ordering
    mesh_blocks: tuple[ElementBlock, ...]
    parameters: tuple[str, ...]

    @property
    def blocks(self) -> tuple[Solids | Tetrahedra, ...]:
        """All element blocks, the hyperelastic ones first."""
        return (*self.solids, *self.tetrahedra)

    @property
    def pattern(self) -> Pattern:
        """Where tangent blocks go."""
        return self.plan.pattern

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric."""
        return all(block.symmetric for block in self.tetrahedra)

    @cached_property
    def rotation_strain(self) -> RotationStrain:
        """Carries displacements between configurations; built when it is first wanted."""
        return RotationStrain.of(self.points, self.mesh_blocks, self.pattern.free_nodes)

    def evaluate(
        self, positions: Floats, pressures: Floats, scales: Floats, *, tangent: bool = True
    ) -> AssembledForces:
        """Evaluate forces, volumes and, where wanted, the tangent.

        Args:
            positions: Current nodes [m], shape (nodes, 3).
            pressures: Gauge pressures [Pa], shape (chambers,).
            scales: Factor on the stiffness of each of ``parameters``.
            tangent: Whether to assemble the tangent.
        """
        forces = np.zeros_like(self.points)
        blocks = np.zeros((self.pattern.slots if tangent else 0, 3, 3))
        # Solids, fibres and chambers have symmetric tangents: one array holds both halves.
        mirror = blocks
        valid = True
        for solid in self.solids:
            valid = valid and solid.forces(positions, scales, forces, blocks, tangent)
        for bars in self.bars:
            bars.forces(positions, scales, forces, blocks, tangent)
        volumes, gradients = np.zeros(self.chambers), np.zeros((self.chambers, *self.points.shape))
        for cavity in self.cavities:
            cavity.volumes(positions, pressures, volumes, gradients, blocks, tangent)
        if self.tetrahedra:
            # From here on the halves differ: co-rotational elements enter theirs into both.
            mirror = blocks.copy()
            for block in self.tetrahedra:
                valid = valid and block.forces(positions, scales, forces, blocks, mirror, tangent)
        # `Tangent.symmetric` tests for the same array, not for an equal one.
        if self.symmetric:
            mirror = blocks
        return AssembledForces(
            forces, volumes, gradients, Tangent(blocks, mirror) if tangent else None, valid
        )

    def parameter_forces(self, positions: Floats) -> Floats:
        """Differentiate the internal forces by the stiffness factors [N], shape (parameters, nodes, 3).

        The forces are linear in the factors, so these are the forces of each part alone at factor 1.
        """
        none = np.zeros(self.chambers)
        units = np.eye(len(self.parameters))
        return np.array([self.evaluate(positions, none, unit, tangent=False).forces for unit in units])

    def nodal_mass(self, densities: Floats) -> Floats:
        """Integrate the regions' densities [kg/m3] to nodal masses [kg], shape (nodes,)."""
        mass = np.zeros(len(self.points))
        for block in self.blocks:
            mass += block.nodal_mass(densities, len(self.points))
        return mass

    def energy_and_stress(self, positions: Floats, scales: Floats) -> tuple[Floats, Floats]:
        """Compute each element's strain energy per volume [J/m3] and von Mises stress [Pa].

        Elements stand in the order of the hyperelastic blocks, then of the co-rotational ones.
        """
        parts = [block.energy_and_stress(positions, scales) for block in self.blocks]
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def build_body(
    mesh: Mesh,
    materials: Mapping[str, Material],
    chambers: tuple[str, ...],
    fibres: Sequence[Membrane | Springs],
    held: Indices,
) -> Body:
    """Prepare a body; see ``FiniteElementModel.build``."""
    solids, tetrahedra = _elements(mesh, _materials(mesh, materials))
    names = [*mesh.regions, *(f.surface if isinstance(f, Membrane) else f.name for f in fibres)]
    bars = build_fibres(mesh, fibres, first=len(mesh.regions))
    cavities = build_cavities(mesh, chambers) if chambers else ()
    groups: list[Indices] = [
        *(solid.connectivity for solid in solids),
        *(tetrahedron.connectivity for tetrahedron in tetrahedra),
        *(bar.nodes for bar in bars),
        *(cavity.facets for cavity in cavities),
    ]
    graph = adjacency(len(mesh.points), groups)
    # The order comes before the pattern, which stores blocks by their place in the elimination.
    ordering = dissect(mesh.points, graph, free_nodes(len(mesh.points), held, groups))
    pattern = build_pattern(len(mesh.points), ordering.order, groups)
    return Body(
        points=np.array(mesh.points, dtype=float),
        solids=tuple(block.attach(pattern) for block in solids),
        tetrahedra=tuple(block.attach(pattern) for block in tetrahedra),
        bars=tuple(bar.attach(pattern) for bar in bars),
        cavities=tuple(cavity.attach(pattern) for cavity in cavities),
        chambers=len(chambers),
        plan=FactorPlan.of(pattern, analyse(pattern, ordering)),
        ordering=ordering,
        mesh_blocks=mesh.blocks,
        parameters=tuple(names),
    )


def build_fibres(mesh: Mesh, fibres: Sequence[Membrane | Springs], first: int) -> tuple[Bars, ...]:
    """Prepare all fibres, those with the same number of nodes together; factors count from ``first``.

    Raises:
        InputError: A surface is unknown or a spring's end lies outside the body.
    """
    parts = []
    for index, fibre in enumerate(fibres, start=first):
        if isinstance(fibre, Springs):
            parts.append(build_springs(mesh, fibre, index))
        else:
            require_known("fibres", "surface", fibre.surface, mesh.surfaces)
            parts.append(build_membrane(mesh, fibre, index))
    return merge_bars(parts)


def _materials(mesh: Mesh, materials: Mapping[str, Material]) -> tuple[Material, ...]:
    for name in mesh.regions:
        require_known(f"region {name!r}", "material", name, materials)
    return tuple(materials[name] for name in mesh.regions)


def _elements(
    mesh: Mesh, materials: tuple[Material, ...]
) -> tuple[tuple[Solids, ...], tuple[Tetrahedra, ...]]:
    """Split every block by the family of its material."""
    linear = np.array([material.corotational for material in materials])
    solids, tetrahedra = [], []
    for block in mesh.blocks:
        of_linear = linear[block.region]
        for wanted in (False, True):
            keep = of_linear == wanted
            if not keep.any():
                continue
            part = ElementBlock(block.kind, block.connectivity[keep], block.region[keep])
            if wanted:
                tetrahedra.append(build_tetrahedra(mesh.points, part, materials))
            else:
                solids.append(build_solids(mesh.points, part, materials))
    return tuple(solids), tuple(tetrahedra)

"""Checks of single element kinds: patch test, rigid modes, order of convergence."""

from collections.abc import Iterator

import numpy as np

from acceptance.verification.box import box, mapped
from acceptance.verification.held import HeldResult, free_body, solve_held, tangent_and_forces
from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem import Material
from softarm.estimator.fem.elements.material import CorotationalLaw, HyperelasticLaw
from softarm.estimator.geometry.faces import boundary_faces
from softarm.estimator.mesh import ElementKind, Mesh
from softarm.estimator.shape_functions import quadrature, shape_functions

KINDS: tuple[ElementKind, ...] = ("tet4", "tet10", "hex8", "hex20")
COROTATIONAL: tuple[CorotationalLaw, ...] = (
    "small",
    "corotational",
    "corotational_polar",
    "corotational_edge_polar",
)
ORDERS = {"tet4": 2.0, "tet10": 2.5, "hex8": 2.0, "hex20": 2.5}
"""Least order of the displacement's mean-square error that passes."""


def distorted(kind: ElementKind, cells: int = 3) -> Mesh:
    """Mesh the unit cube with inner corners moved and edges kept straight."""
    mesh = box(kind, (cells, cells, cells), (1.0, 1.0, 1.0))

    def bent(x: Floats) -> Floats:
        bubble = np.prod(np.sin(np.pi * x), axis=1, keepdims=True)
        return np.asarray(x + 0.06 * bubble * np.array([1.0, -0.7, 0.5]))

    corners = 4 if kind.startswith("tet") else 8
    moved = mapped(mesh, bent)
    if kind in {"tet4", "hex8"}:
        return moved
    linear = box("tet4" if corners == 4 else "hex8", (cells, cells, cells), (1.0, 1.0, 1.0))
    points = moved.points.copy()
    middles = np.arange(len(linear.points), len(points))
    ends = _edge_ends(mesh, middles)
    points[middles] = 0.5 * (points[ends[:, 0]] + points[ends[:, 1]])
    return mapped(mesh, lambda _: points)


def _edge_ends(mesh: Mesh, middles: Indices) -> Indices:
    """Find the corners on both sides of each mid-edge node."""
    from_rest = {}
    corners = mesh.points[: int(middles[0])]
    lookup = {tuple(np.round(point, 9)): k for k, point in enumerate(corners)}
    connectivity = mesh.blocks[0].connectivity
    count = 4 if mesh.blocks[0].kind == "tet10" else 8
    for element in connectivity:
        local = corners[element[:count]]
        for middle in element[count:]:
            gap = np.abs(0.5 * (local[:, None] + local[None]) - mesh.points[middle]).sum(axis=2)
            gap[np.diag_indices(count)] = np.inf
            a, b = np.unravel_index(np.argmin(gap), gap.shape)
            from_rest[int(middle)] = (
                lookup[tuple(np.round(local[a], 9))],
                lookup[tuple(np.round(local[b], 9))],
            )
    return np.array([from_rest[int(middle)] for middle in middles])


def patch_test(kind: ElementKind, law: HyperelasticLaw | CorotationalLaw = "neo_hookean") -> HeldResult:
    """Prescribe a homogeneous deformation on the boundary of a distorted mesh: it must hold inside."""
    mesh = distorted(kind)
    # The edge frames differ between elements by the order of the strain, and with them the stresses.
    framed = law in {"corotational", "corotational_edge_polar"}
    strain = 1e-4 if framed else 1.0
    gradient = strain * np.array([[0.12, 0.05, -0.03], [0.02, -0.08, 0.06], [-0.04, 0.03, 0.1]])
    exact = mesh.points @ gradient.T
    outside = np.zeros((len(mesh.points), 3), dtype=bool)
    outside[np.unique(boundary_faces(mesh.blocks[0].kind, mesh.blocks[0].connectivity))] = True
    body = free_body(mesh, Material(law, 1.0, 0.4, shape=(0.3, 0.1)))
    found = solve_held(
        body, outside, lambda fraction: fraction * exact, np.zeros_like(exact), steps=3, tolerance=1e-8
    )
    error = float(np.abs(found - exact).max() / np.abs(exact).max())
    limit = 0.2 * strain if framed else 1e-9
    return HeldResult(
        "patch test", f"{kind}, {law}", 0.0, error, error, limit, "homogeneous deformation (Irons 1966)"
    )


def rigid_modes(kind: ElementKind, law: HyperelasticLaw | CorotationalLaw = "neo_hookean") -> HeldResult:
    """Count the modes without stiffness of a free body, and see that a finite turn makes no force."""
    mesh = distorted(kind, 2)
    body = free_body(mesh, Material(law, 1.0, 0.4, shape=(0.3, 0.1)))
    matrix, _ = tangent_and_forces(body, np.zeros_like(mesh.points))
    stiffness = np.linalg.eigvalsh(0.5 * (matrix + matrix.T).toarray())
    modes = int((stiffness < 1e-9 * stiffness[-1]).sum())
    angle = 1.1
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    _, forces = tangent_and_forces(body, mesh.points @ turn.T - mesh.points + 0.3)
    turned = 0.0 if law == "small" else float(np.abs(forces).max() / np.abs(matrix).max())
    error = abs(modes - 6) + turned
    return HeldResult("rigid modes", f"{kind}, {law}", 6.0, float(modes), error, 1e-12, "frame indifference")


def _papkovich(x: Floats, poisson: float) -> Floats:
    """Evaluate u = 4 (1 - nu) psi e_x - grad(x psi), psi harmonic: an equilibrium without body force."""
    k = np.sqrt(2.0)
    sx, cx, sy = np.sin(x[:, 0]), np.cos(x[:, 0]), np.sin(x[:, 1] + 0.3)
    cy, ez = np.cos(x[:, 1] + 0.3), np.exp(k * x[:, 2])
    psi = sx * sy * ez
    slope = np.column_stack([cx * sy * ez, sx * cy * ez, k * psi])
    field = -x[:, :1] * slope
    field[:, 0] += (3.0 - 4.0 * poisson) * psi
    return np.asarray(field)


def convergence(kind: ElementKind, cells: tuple[int, ...] = (2, 4, 8), poisson: float = 0.3) -> HeldResult:
    """Observe the order of the error under refinement, for an exact solution of linear elasticity."""
    errors = []
    for count in cells:
        mesh = box(kind, (count, count, count), (1.0, 1.0, 1.0))
        exact = 1e-7 * _papkovich(mesh.points, poisson)
        outside = np.zeros((len(mesh.points), 3), dtype=bool)
        outside[np.unique(boundary_faces(mesh.blocks[0].kind, mesh.blocks[0].connectivity))] = True
        body = free_body(mesh, Material("neo_hookean", 1.0, poisson))
        found = solve_held(body, outside, lambda _, exact=exact: exact, np.zeros_like(exact), tolerance=1e-6)  # type: ignore[misc]
        errors.append(_mean_square_error(mesh, found, poisson))
    order = float(np.log(errors[-2] / errors[-1]) / np.log(cells[-1] / cells[-2]))
    shortfall = max(0.0, ORDERS[kind] - 0.2 - order)
    return HeldResult(
        "order of convergence", f"{kind}, displacement", ORDERS[kind], order, shortfall, 0.0,
        "exact solution after Papkovich (1932)",
    )  # fmt: skip


def _mean_square_error(mesh: Mesh, found: Floats, poisson: float) -> float:
    block = mesh.blocks[0]
    places, weights = quadrature("tet10" if block.kind.startswith("tet") else "hex8")
    values, slopes = shape_functions(block.kind, places)
    corners = mesh.points[block.connectivity]
    measure = np.linalg.det(np.einsum("eni,qnk->eqik", corners, slopes)) * weights
    spots = np.einsum("eni,qn->eqi", corners, values)
    field = np.einsum("eni,qn->eqi", found[block.connectivity], values)
    gap = field - 1e-7 * _papkovich(spots.reshape(-1, 3), poisson).reshape(field.shape)
    return float(np.sqrt((measure * (gap**2).sum(axis=2)).sum()))


def element_results(quick: bool) -> Iterator[HeldResult]:
    """Run the checks of every kind and law."""
    for kind in KINDS:
        yield patch_test(kind)
        yield rigid_modes(kind)
    for law in COROTATIONAL:
        yield patch_test("tet4", law)
        yield rigid_modes("tet4", law)
    for kind in KINDS:
        yield convergence(kind, (2, 4) if quick else (2, 4, 8) if kind.endswith("0") else (4, 8, 12))

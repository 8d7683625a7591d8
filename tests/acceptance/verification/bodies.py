"""Checks against published and analytic answers: cylinder, cantilever, membrane, chamber."""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from acceptance.verification.box import box, mapped, with_nodes, with_surface
from acceptance.verification.held import HeldResult, facet_forces, free_body, solve_held
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel, Material, Settings
from softarm.estimator.mesh import ElementKind
from softarm.estimator.model import Inputs, Load

INNER, OUTER = 0.01, 0.02
COOK_TIP = 6.9
"""Vertical displacement of the upper corner under 100 per unit of thickness [length units of the problem]."""


def lame_cylinder(
    kind: ElementKind, poisson: float, limit: float, cells: tuple[int, int, int] = (4, 6, 1)
) -> HeldResult:
    """Load a quarter of a thick-walled cylinder by internal pressure in plane strain, in the linear range.

    u(r) = (1 + nu) p a^2 / (E (b^2 - a^2)) [(1 - 2 nu) r + b^2 / r]
    """
    young, pressure = 3e5, 1.0
    mesh = mapped(box(kind, cells, (1.0, 1.0, 1.0)), _quarter)
    mesh = with_surface(
        mesh, "bore", lambda x: np.hypot(x[:, 0], x[:, 1]) < INNER + 0.2 * (OUTER - INNER) / cells[0]
    )
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    held[np.abs(mesh.points[:, 0]) < 1e-9, 0] = True
    held[np.abs(mesh.points[:, 1]) < 1e-9, 1] = True
    held[:, 2] = True
    force = facet_forces(mesh, "bore", lambda _, normal: -pressure * normal)
    body = free_body(mesh, Material("neo_hookean", young, poisson))
    found = solve_held(body, held, lambda _: np.zeros_like(mesh.points), force, tolerance=1e-7)
    radius = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    bore = radius < INNER * 1.0001
    outward = (found[bore, :2] * mesh.points[bore, :2]).sum(axis=1) / radius[bore]
    expected = (
        (1.0 + poisson)
        * pressure
        * INNER**2
        / (young * (OUTER**2 - INNER**2))
        * ((1.0 - 2.0 * poisson) * INNER + OUTER**2 / INNER)
    )
    error = float(np.abs(outward / expected - 1.0).max())
    return HeldResult(
        "thick-walled cylinder", f"{kind}, nu = {poisson}", expected, float(outward.mean()), error, limit,
        "Lame (1852), bore displacement [m]",
    )  # fmt: skip


def _quarter(x: Floats) -> Floats:
    """Roll the unit cube into a quarter of the cylinder."""
    radius, angle = INNER + (OUTER - INNER) * x[:, 0], 0.5 * np.pi * x[:, 1]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.002 * x[:, 2]])


def elastica_tip(load: float) -> tuple[float, float]:
    """Return the lateral and axial displacement of the tip of an inextensible cantilever, over its length.

    theta'' = -load cos(theta), theta(0) = 0, theta'(1) = 0, load = F L^2 / (E I) (Bisshopp and Drucker 1945).
    """

    def shoot(bend: float) -> Floats:
        def rate(_: float, state: Floats) -> Floats:
            return np.array([state[1], -load * np.cos(state[0]), np.sin(state[0]), np.cos(state[0])])

        start = np.array([0.0, bend, 0.0, 0.0])
        return np.asarray(solve_ivp(rate, (0.0, 1.0), start, rtol=1e-10, atol=1e-12).y[:, -1])

    root = float(brentq(lambda bend: float(shoot(bend)[1]), 1e-6, 2.0 * load))
    end = shoot(root)
    return float(end[2]), float(1.0 - end[3])


def elastica(kind: ElementKind, load: float, limit: float, cells: tuple[int, int, int]) -> HeldResult:
    """Bend a slender cantilever far by a force at its tip that keeps its direction."""
    length, width, young = 0.3, 0.005, 3e5
    mesh = box(kind, cells, (width, width, length))
    mesh = with_nodes(mesh, "clamp", lambda x: x[:, 2] < 1e-9)
    mesh = with_nodes(mesh, "section_tip", lambda x: x[:, 2] > length - 1e-9)
    model = FiniteElementModel.build(
        mesh,
        {"body": Material("neo_hookean", young, 0.01, 0.0)},
        sections=["tip"],
        loads=[Load("tip", "force", (1.0, 0.0, 0.0), "tip")],
        settings=Settings(tolerance=1e-8),
    )
    force = load * young * width**4 / 12.0 / length**2
    found = model.equilibrium(Inputs(np.zeros(0), np.array([force]), np.zeros(3)))
    tip = model.section_frames(found.value).positions[0]
    lateral = float((tip[0] - width / 2.0) / length)
    expected, _ = elastica_tip(load)
    error = abs(lateral / expected - 1.0) if found.converged else np.inf
    return HeldResult(
        "elastica", f"{kind}, F L^2/EI = {load:g}", expected, lateral, error, limit,
        "Bisshopp and Drucker (1945), lateral tip displacement over length",
    )  # fmt: skip


def cook_membrane(kind: ElementKind, cells: int, limit: float, steps: int = 12) -> HeldResult:
    """Shear Cook's tapered panel in plane strain, mu = 80.1938 and kappa = 401889.8, large displacements."""
    shear, bulk, thickness = 80.1938, 401889.8, 1.0
    poisson = (3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear)
    mesh = box(kind, (cells, cells, 1), (1.0, 1.0, thickness))

    def panel(x: Floats) -> Floats:
        return np.column_stack([48.0 * x[:, 0], 44.0 * x[:, 0] + (44.0 - 28.0 * x[:, 0]) * x[:, 1], x[:, 2]])

    mesh = with_surface(mapped(mesh, panel), "edge", lambda x: x[:, 0] > 48.0 - 1e-6)
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    held[mesh.points[:, 0] < 1e-9] = True
    held[:, 2] = True
    traction = np.array([0.0, 100.0 / 16.0 / thickness, 0.0])
    force = facet_forces(mesh, "edge", lambda spot, _: np.broadcast_to(traction, spot.shape))
    body = free_body(mesh, Material("neo_hookean", 2.0 * shear * (1.0 + poisson), poisson))
    found = solve_held(body, held, lambda _: np.zeros_like(mesh.points), force, steps=steps, tolerance=1e-7)
    corner = np.argmin(np.abs(mesh.points - [48.0, 60.0, 0.0]).sum(axis=1))
    tip = float(found[corner, 1])
    return HeldResult(
        "Cook's membrane", f"{kind}, {cells} x {cells}, nu = {poisson:.4f}", COOK_TIP, tip,
        abs(tip / COOK_TIP - 1.0), limit, "de Souza Neto et al. (1996), vertical displacement of the corner",
    )  # fmt: skip


def body_results(quick: bool) -> Iterator[HeldResult]:
    """Run the checks of whole bodies."""
    yield lame_cylinder("hex20", 0.3, 2e-3)
    yield lame_cylinder("hex20", 0.4999, 5e-3)
    yield lame_cylinder("hex8", 0.4999, 3e-2, (8, 12, 1))
    yield lame_cylinder("tet10", 0.4999, 1e-2)
    for load in (1.0, 5.0):
        yield elastica("hex20", load, 5e-3, (1, 1, 24))
    yield cook_membrane("hex20", 8, 0.02)
    if not quick:
        yield elastica("tet10", 5.0, 1e-2, (1, 1, 24))
        yield cook_membrane("hex8", 16, 0.02)
        yield cook_membrane("tet10", 12, 0.02)

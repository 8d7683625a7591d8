"""``softarm bench mesh``: how far each kind of mesh is from a converged answer."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import click
import numpy as np

from acceptance.convert import to_elements
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm.estimator.arm import build_arm, model_on_mesh
from softarm.estimator.geometry import DEFAULTS, Resolution, build_mesh
from softarm.estimator.mesh import ElementKind
from softarm.estimator.rotations import log
from softarm.estimator.specimen import SHIPPED, Specimen, load_specimen

LARGEST_ERROR = 0.015
LARGEST_SPREAD = 0.01
INCOMPRESSIBLE = 0.499


SHARES = (0.05, 0.3, 0.6)
"""Of the pressure limit, at which the first chamber alone bends the arm."""


@dataclass(frozen=True)
class MeshTrial:
    """One mesh to try.

    Args:
        elements: Kind of element.
        resolution: Divisions of the hexahedra that it is made of.
        poisson: Poisson's ratio of every material; the specimen's when ``None``.
        heavy: Left out of the quick form.
    """

    elements: ElementKind
    resolution: Resolution
    poisson: float | None = None
    heavy: bool = False


@dataclass(frozen=True)
class Response:
    """What a mesh answers to small loads about its rest.

    Args:
        nodes: Nodes of the mesh.
        elements: Elements of the mesh.
        values: Tip displacement per lateral tip force [m/N] as ``force``, and the rotation of each segment
            per pressure in its first chamber [rad/Pa] under the segment's name.
    """

    nodes: int
    elements: int
    values: dict[str, float]


def respond(specimen: Specimen, trial: MeshTrial) -> Response:
    """Mesh a specimen as a trial says, and give its small-load responses."""
    if trial.poisson is not None:
        materials = {
            name: material.model_copy(update={"poisson_ratio": trial.poisson})
            for name, material in specimen.materials.items()
        }
        specimen = specimen.model_copy(update={"materials": materials})
    mesh = to_elements(build_mesh(specimen, trial.resolution), trial.elements)
    model = model_on_mesh(specimen, mesh)
    step = model.linearise(model.rest(), model.no_inputs())
    _, change = step.response(np.eye(6 * len(model.sections)))
    twists = change.reshape(len(model.sections), 6, -1)
    loads = [load.name for load in model.loads]
    values = {"force": float(twists[-1, 0, model.chambers + loads.index("tip_x")])}
    for segment in specimen.segments:
        first = next((c.index for c in specimen.chambers if c.segment == segment.name), None)
        if first is not None:
            ends = [s.frame_origin_m[2] >= segment.to_m for s in specimen.sections]
            below = ends.index(True)
            turn = twists[below, 3:, first] - twists[below - 1, 3:, first]
            values[segment.name] = float(np.linalg.norm(turn))
    return Response(len(mesh.points), sum(len(block.connectivity) for block in mesh.blocks), values)


def bends(specimen: Specimen, resolution: Resolution) -> list[float]:
    """Rotate the last section by the first chamber at each of ``SHARES`` [degrees]; NaN where not solved."""
    model = build_arm(specimen, (), resolution)
    state, found = model.rest(), []
    for share in SHARES:
        pressures = share * specimen.pressure_limits[0] * np.eye(model.chambers)[0]
        solution = model.equilibrium(replace(model.no_inputs(), pressures=pressures), state)
        state = solution.value
        rotations = model.section_frames(state).rotations
        turn = np.linalg.norm(log((rotations[-1] @ rotations[0].T)[None]))
        found.append(float(np.degrees(turn)) if solution.converged else np.nan)
    return found


def bend_table(specimen: Specimen) -> Table:
    """Compare how far an arm bends with its default mesh and with every edge of it halved."""
    default = DEFAULTS[specimen.geometry.kind]
    coarse, fine = bends(specimen, default), bends(specimen, replace(default, refinement=2))
    rows: list[dict[str, Cell]] = [
        {"share of limit": share, "default_deg": one, "halved_deg": two, "percent": 100.0 * (one / two - 1.0)}
        for share, one, two in zip(SHARES, coarse, fine, strict=True)
    ]
    return Table(f"{specimen.name}: bend with chamber 0 alone under pressure", rows)


def trials(specimen: Specimen) -> Iterator[tuple[str, MeshTrial]]:
    """List the meshes of the table, each with what the table calls it."""
    default = DEFAULTS[specimen.geometry.kind]
    slender = Resolution(layers=6, section_layers=2)
    wide = Resolution(around=2, through=2, layers=12, section_layers=3)
    fine = Resolution(around=3, through=3, layers=18, section_layers=4)
    yield "linear tetrahedra", MeshTrial("tet4", slender)
    yield "linear tetrahedra", MeshTrial("tet4", wide)
    yield "linear tetrahedra", MeshTrial("tet4", fine, heavy=True)
    yield "quadratic tetrahedra, curved", MeshTrial("tet10", slender)
    yield "quadratic tetrahedra, curved", MeshTrial("tet10", wide, heavy=True)
    yield "trilinear hexahedra, mean dilatation", MeshTrial("hex8", slender)
    yield "trilinear hexahedra, mean dilatation", MeshTrial("hex8", wide)
    yield "trilinear hexahedra, mean dilatation", MeshTrial("hex8", fine, heavy=True)
    yield "20-node hexahedra, default", MeshTrial("hex20", default)
    yield (
        "20-node hexahedra, twice the layers",
        MeshTrial("hex20", Resolution(default.around, default.through, 2 * default.layers, 2)),
    )
    yield "20-node hexahedra, each in 8", MeshTrial("hex20", replace(default, refinement=2))
    yield f"linear tetrahedra, nu = {INCOMPRESSIBLE}", MeshTrial("tet4", slender, INCOMPRESSIBLE)
    yield (
        f"20-node hexahedra, default, nu = {INCOMPRESSIBLE}",
        MeshTrial("hex20", default, INCOMPRESSIBLE),
    )


def measure(
    specimen: Specimen, quick: bool, done: Callable[[float], None]
) -> tuple[list[dict[str, Cell]], dict[str, float], Response]:
    """Try every mesh of a specimen against its refined default.

    Args:
        specimen: Description.
        quick: Divide the reference's elements in 2, not 4, along each edge, and leave out the large meshes.
        done: Called with 1 after each mesh.

    Returns:
        The table's rows, the default's errors by response, and the reference.
    """
    default = DEFAULTS[specimen.geometry.kind]
    finest = replace(default, refinement=2 if quick else 4)
    references: dict[float | None, Response] = {None: respond(specimen, MeshTrial("hex20", finest))}
    done(1)
    references[INCOMPRESSIBLE] = respond(
        specimen, MeshTrial("hex20", replace(default, refinement=2), INCOMPRESSIBLE)
    )
    done(1)
    rows: list[dict[str, Cell]] = []
    errors: dict[str, float] = {}
    for name, trial in trials(specimen):
        if not (quick and (trial.heavy or trial.resolution == finest)):
            found, reference = respond(specimen, trial), references[trial.poisson]
            ratios = {key: found.values[key] / reference.values[key] for key in reference.values}
            rows.append({"mesh": name, "nodes": found.nodes, "elements": found.elements, **ratios})
            if trial == MeshTrial("hex20", default):
                errors = {key: ratio - 1.0 for key, ratio in ratios.items()}
        done(1)
    return rows, errors, references[None]


def judge(errors: dict[str, float]) -> list[dict[str, Cell]]:
    """Hold the default's errors against their limits."""
    rows: list[dict[str, Cell]] = [
        {"error of the default": key, "percent": 100.0 * error, "limit": 100.0 * LARGEST_ERROR}
        for key, error in errors.items()
    ]
    spread = max(errors.values()) - min(errors.values())
    rows.append(
        {"error of the default": "spread", "percent": 100.0 * spread, "limit": 100.0 * LARGEST_SPREAD}
    )
    return [
        {**row, "passes": abs(float(row["percent"] or 0.0)) <= float(row["limit"] or 0.0)} for row in rows
    ]


@click.command()
@click.option(
    "--specimen", "names", multiple=True, default=("sopra",), help=f"Specimen; shipped: {', '.join(SHIPPED)}."
)
@click.option("--bends", "bending", is_flag=True, help="Only bend the arm: its default mesh and a finer one.")
@quick_option
@json_option
def command(names: tuple[str, ...], bending: bool, quick: bool, as_json: bool) -> int:
    """Compare the meshes of a specimen with its default mesh, refined.

    The table shows ratios of small-load responses: the tip's displacement per lateral tip force, and each
    segment's rotation per pressure in one of its chambers; 1 is converged. The exit status is 1 if the
    default's error exceeds 1.5 %, or its errors for force and pressure differ by more than 1 %.

    Example: softarm bench mesh --quick
    """
    tables, passed = [], True
    specimens = [load_specimen(name) for name in names]
    if bending:
        show(*map(bend_table, specimens), as_json=as_json)
        return 0
    with progress("Meshes", 15 * len(specimens)) as advance:
        for specimen in specimens:
            rows, errors, reference = measure(specimen, quick, advance)
            verdict = judge(errors)
            passed = passed and all(row["passes"] for row in verdict)
            note = (
                f"Ratios to the default with every edge divided in {2 if quick else 4}: {reference.nodes} "
                f"nodes, {reference.elements} elements; for nu = {INCOMPRESSIBLE}, divided in 2. "
                "The tetrahedra split hexahedra of a sweep and are up to ten times as long as wide."
            )
            tables.append(Table(f"{specimen.name}: responses of its meshes", rows, (note,)))
            tables.append(Table(f"{specimen.name}: errors of the default mesh", verdict))
    show(*tables, as_json=as_json)
    return 0 if passed else 1

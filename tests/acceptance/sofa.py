"""``softarm bench sofa``: the same meshes, material and loads as SOFA's reference solutions."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import click
import numpy as np

from acceptance.forces import forces_problem, independent_prior
from softarm.cli.output import PATH, json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.fem import FiniteElementModel, Material, SectionNodes
from softarm.estimator.inverse import Tolerances, Unknowns
from softarm.estimator.mesh import ElementBlock, ElementSurface, Mesh
from softarm.estimator.model import Inputs, Load
from softarm.estimator.sensing import MarkerPosition, SensorSuite

MESHES = ("sopra_464", "sopra_1184")
LAWS = {"small": "small", "large": "corotational", "polar": "corotational_edge_polar"}
DISPLACEMENT_LIMIT = 1e-5
FORCE_LIMIT_N = 1e-5
MARKER_SIGMA_M = 1e-9
FORCE_SIGMA_N = 1e3


FORWARD_ONCE = "forward, one linearisation"
FORWARD = "forward, converged from rest"
INVERSE_STEPS = tuple(
    f"inverse, 3 forces, {count}"
    for count in ("one linearisation", "two linearisations", "three linearisations")
)
INVERSE = "inverse, 3 forces, converged"
UNKNOWN_ONCE = "inverse, 3 forces and 6 pressures, one linearisation"
PUBLISHED: Mapping[str, Mapping[str, float]] = {
    "sopra_464": {FORWARD_ONCE: 5.0, FORWARD: 69.0, INVERSE_STEPS[0]: 7.4, UNKNOWN_ONCE: 8.1},
    "sopra_1184": {FORWARD_ONCE: 26.0, FORWARD: 268.0, INVERSE_STEPS[0]: 35.0, UNKNOWN_ONCE: 37.0},
}
"""Median processor time of SOFA's steps by its reference [ms], the shortest where that gives a range."""
PUBLISHED_RMSE_MN = dict(zip(INVERSE_STEPS, (1.24, 0.023, 0.0024), strict=True))
"""Error of its forces after so many steps per target."""
CONVERGED = Tolerances(step=1e-8, residual=1e-8)
PRESSURE_SIGMA_PA = 1e5
REPEATS = 20


@dataclass(frozen=True)
class Followed:
    """Estimates along a trajectory.

    Args:
        errors_mn: Of the forces, shape (samples, 3).
        spent_ms: Processor time of each, shape (samples,).
        linearisations: Mean number of each.
        not_converged: How many did not converge.
    """

    errors_mn: Floats
    spent_ms: Floats
    linearisations: float
    not_converged: int

    @property
    def rmse_mn(self) -> float:
        """Root mean square of the length of the error."""
        return float(np.sqrt((self.errors_mn**2).sum(axis=1).mean()))


@dataclass(frozen=True)
class Reference:
    """One mesh of the reference with its solutions.

    Args:
        name: Name of the mesh.
        mesh: Mesh with its clamp, tip and chambers.
        about: Material and load cases, as the reference states them.
        displacements: ``u_m|<force field>|<method>|<mass>|<case>`` to displacements [m], shape (nodes, 3).
        nodal_volume: Volume of each node [m3], shape (nodes,).
        trajectory: Loads and marker positions of the inverse reference.
    """

    name: str
    mesh: Mesh
    about: dict[str, Any]
    displacements: dict[str, Floats]
    nodal_volume: Floats
    trajectory: dict[str, Floats]

    def nodal_mass(self, mass: str) -> Floats:
        """Return the masses of the nodes [kg] under the reference's mass model, ``uniform`` or ``lumped``."""
        if mass == "uniform":
            return np.full(len(self.mesh.points), self.about["uniform_nodal_mass_kg"])
        return self.nodal_volume * float(self.about["rho"])

    def model(self, law: str, mass: str, sections: tuple[SectionNodes, ...] = ()) -> FiniteElementModel:
        """Build the model of this mesh."""
        tip = [Load(f"tip_{a}", "force", tuple(row), "tip") for a, row in zip("xyz", np.eye(3), strict=True)]
        material = Material(law, self.about["E_Pa"], self.about["nu"])  # type: ignore[arg-type]
        return FiniteElementModel.build(
            self.mesh,
            {"body": material},
            sections=("tip", *sections),
            loads=tip,
            nodal_mass=self.nodal_mass(mass),
        )

    def inputs(self, case: str) -> Inputs:
        """Return the inputs of a load case."""
        loads = self.about["cases"][case]
        gravity = [0.0, 0.0, -self.about["g"] if loads["gravity"] else 0.0]
        return Inputs(*(np.array(v, float) for v in (loads["pressure_Pa"], loads["tip_force_N"], gravity)))


def read_reference(folder: Path, name: str) -> Reference:
    """Read one mesh of the reference.

    Raises:
        InputError: A file is missing.
    """
    files = [
        folder / file for file in (f"{name}.npz", f"ref_{name}.npz", f"ref_{name}.json", f"traj_{name}.npz")
    ]
    for file in files:
        if not file.is_file():
            raise InputError(str(file), "there is no such file", "give its folder with --reference DIR")
    with np.load(files[0]) as data:
        shape = {key: data[key] for key in data.files}
    with np.load(files[1]) as data:
        displacements = {key: data[key] for key in data.files if key.startswith("u_m|")}
    with np.load(files[3]) as data:
        trajectory = {key: data[key] for key in data.files if key != "note"}
    tetrahedra = shape["tets"].astype(np.int64)
    walls = {
        f"chamber_{k}": ElementSurface("tri3", shape[f"chamber{k}_tris"].astype(np.int64)) for k in range(6)
    }
    mesh = Mesh(
        shape["points"],
        (ElementBlock("tet4", tetrahedra, np.zeros(len(tetrahedra), dtype=np.int64)),),
        ("body",),
        walls,
        {"clamp": shape["fixed_nodes"], "section_tip": shape["tip_nodes"]},
    )
    about = json.loads(files[2].read_text())
    return Reference(name, mesh, about, displacements, shape["nodal_volume"], trajectory)


def forward(reference: Reference) -> Iterator[dict[str, Cell]]:
    """Compare every equilibrium whose method we have; one row per method and mass model."""
    groups: dict[tuple[str, str, str], list[tuple[str, Floats]]] = {}
    for key, displacement in reference.displacements.items():
        _, field, method, mass, case = key.split("|")
        if method in LAWS:
            groups.setdefault((field, method, mass), []).append((case, displacement))
    for (field, method, mass), cases in groups.items():
        model = reference.model(LAWS[method], mass)
        errors, iterations, seconds = [], 0, 0.0
        for case, expected in cases:
            started = process_time()
            found = model.equilibrium(reference.inputs(case))
            seconds += process_time() - started
            iterations += found.iterations
            gap = np.linalg.norm(found.value.displacement - expected, axis=1).max()
            errors.append(gap / np.linalg.norm(expected, axis=1).max() if found.converged else np.inf)
        yield {
            "mesh": reference.name,
            "force_field": field.removesuffix("ForceField"),
            "method": method,
            "gravity": mass,
            "cases": len(cases),
            "worst_relative_error": float(max(errors)),
            "worst_case": cases[int(np.argmax(errors))][0],
            "solves_per_case": iterations / len(cases),
            "cpu_ms_per_case": 1e3 * seconds / len(cases),
        }


@dataclass(frozen=True)
class Inverse:
    """The inverse problem along the trajectory: loads from six markers.

    Args:
        reference: Mesh and trajectory.
        pressure_sigma: Standard deviations of the pressures [Pa], shape (chambers,); ``None`` when known.
    """

    reference: Reference
    pressure_sigma: Floats | None = None

    def follow(self, samples: int, tolerances: Tolerances) -> Followed:
        """Estimate the three tip forces of the first samples, each from where the last one ended."""
        trajectory, points = self.reference.trajectory, self._points()
        model = self.reference.model("corotational", "uniform", points)
        first = len(model.sections) - len(points)
        suite = SensorSuite(
            tuple(
                MarkerPosition(p.name, first + k, MARKER_SIGMA_M, np.zeros(3)) for k, p in enumerate(points)
            )
        )
        unknowns = Unknowns.of(model.chambers, model.loads, force=0.05)
        prior = independent_prior(unknowns, FORCE_SIGMA_N)
        gravity = np.array([0.0, 0.0, -self.reference.about["g"]])
        pressures, forces = trajectory["pressure_Pa"], trajectory["tip_force_N"]
        readings = trajectory["marker_positions_m"].reshape(len(forces), -1)
        start = Inputs(pressures[0], np.zeros(3), gravity)
        state, _ = model.solve(start, model.rest())
        errors, spent, iterations, failed = np.empty((samples, 3)), np.empty(samples), 0, 0
        for sample in range(samples):
            problem = forces_problem(
                unknowns, suite, readings[sample], pressures[sample], self.pressure_sigma, prior, gravity
            )
            started = process_time()
            estimate = problem.solve(model, (state, start), tolerances)
            spent[sample] = 1e3 * (process_time() - started)
            state, start = estimate.state, estimate.inputs
            errors[sample] = 1e3 * (estimate.inputs.loads - forces[sample])
            iterations += estimate.iterations
            failed += not estimate.converged
        return Followed(errors, spent, iterations / samples, failed)

    def _points(self) -> tuple[SectionNodes, ...]:
        nodes, places = self.reference.trajectory["markers"].astype(int), self.reference.mesh.points
        return tuple(SectionNodes(f"marker_{k}", point=tuple(places[node])) for k, node in enumerate(nodes))


def inverse_row(reference: Reference, samples: int, found: Followed) -> dict[str, Cell]:
    """State the converged solutions with the pressures known."""
    return {
        "mesh": reference.name,
        "samples": samples,
        "not_converged": found.not_converged,
        "force_rmse_mn": found.rmse_mn,
        "force_worst_mn": float(np.linalg.norm(found.errors_mn, axis=1).max()),
        "force_range_mn": 1e3 * float(np.ptp(reference.trajectory["tip_force_N"], axis=0).max()),
        "iterations_per_sample": found.linearisations,
        "cpu_ms_per_sample": float(found.spent_ms.mean()),
    }


def side_by_side(reference: Reference, samples: int, converged: Followed) -> Iterator[dict[str, Cell]]:
    """State time and error of each step beside what is published of SOFA's on the same mesh."""
    known, unknown = Inverse(reference), Inverse(reference, np.full(6, PRESSURE_SIGMA_PA))
    model = reference.model("corotational", "uniform")
    inputs = [reference.inputs(case) for case in reference.about["cases"]]
    still = np.zeros(model.chambers + len(model.loads))

    def linearised(at: Inputs) -> None:
        model.advance(model.linearise(model.rest(), at), still)

    ours: dict[str, tuple[Floats, float | None]] = {
        FORWARD_ONCE: (_times(lambda: linearised(inputs[0]), REPEATS), None),
        FORWARD: (np.array([_times(partial(model.equilibrium, one), 1) for one in inputs]).ravel(), None),
    }
    for count, name in enumerate(INVERSE_STEPS, start=1):
        found = known.follow(samples, Tolerances(iterations=count))
        ours[name] = found.spent_ms, found.rmse_mn
    ours[INVERSE] = converged.spent_ms, converged.rmse_mn
    found = unknown.follow(samples, Tolerances(iterations=1))
    ours[UNKNOWN_ONCE] = found.spent_ms, None
    for step, (spent, rmse) in ours.items():
        published, published_rmse = PUBLISHED[reference.name].get(step), PUBLISHED_RMSE_MN.get(step)
        median = float(np.median(spent))
        yield {
            "mesh": reference.name,
            "step": step,
            "sofa_ms": published,
            "cpu_ms": median,
            "times_sofa": None if published is None else median / published,
            "sofa_rmse_mn": published_rmse,
            "force_rmse_mn": rmse,
        }


def _times(work: Callable[[], object], repeats: int) -> Floats:
    """Return the processor time of calls [ms]."""
    spent = np.empty(repeats)
    for k in range(repeats):
        started = process_time()
        work()
        spent[k] = 1e3 * (process_time() - started)
    return spent


@click.command()
@click.option(
    "--reference",
    "folder",
    type=PATH,
    default=Path("../shared/reference/sofa"),
    show_default=True,
    help="Folder of SOFA's reference solutions.",
)
@quick_option
@json_option
def command(folder: Path, quick: bool, as_json: bool) -> int:
    """Compare with SOFA's equilibria and inverse trajectories on its own meshes.

    The exit status is 1 if an equilibrium is off by more than 1e-5 of the largest displacement, or an
    estimated force by more than 0.01 mN rms.

    Example: softarm bench sofa --reference ../shared/reference/sofa
    """
    names = MESHES[:1] if quick else MESHES
    references = [read_reference(folder, name) for name in names]
    with progress("SOFA", len(references) * 3) as advance:
        forward_rows: list[dict[str, Cell]] = []
        inverse_rows: list[dict[str, Cell]] = []
        compared: list[dict[str, Cell]] = []
        for reference in references:
            forward_rows.extend(forward(reference))
            advance(1)
            samples = 30 if quick else len(reference.trajectory["tip_force_N"])
            converged = Inverse(reference).follow(samples, CONVERGED)
            inverse_rows.append(inverse_row(reference, samples, converged))
            advance(1)
            compared.extend(side_by_side(reference, samples, converged))
            advance(1)
    show(
        Table(
            "Side by side: processor time of a step and error of its forces, on the same mesh",
            compared,
            (
                "sofa_ms, sofa_rmse_mn: published with its reference, from a machine of the same kind.",
                "times_sofa: our median time over that. One thread.",
                "One linearisation: assembly, factor and one step, which leaves the arm out of balance.",
                "Converged: SOFA to 1e-6 N (12 to 15 linearisations), ours to a relative residual of 1e-8.",
            ),
        ),
        Table(
            "Equilibria: largest nodal difference from SOFA over the largest displacement",
            forward_rows,
            (f"Limit {DISPLACEMENT_LIMIT:g}. SOFA v25.06; its method 'svd' has no counterpart here.",),
        ),
        Table(
            "Inverse: three tip forces from six markers along SOFA's trajectory, pressures known, no noise",
            inverse_rows,
            (f"Limit {1e3 * FORCE_LIMIT_N:g} mN rms.",),
        ),
        as_json=as_json,
    )
    good = all(float(row["worst_relative_error"] or 0.0) <= DISPLACEMENT_LIMIT for row in forward_rows)
    good &= all(float(row["force_rmse_mn"] or 0.0) <= 1e3 * FORCE_LIMIT_N for row in inverse_rows)
    return 0 if good else 1

"""The finite-element model of an arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError, require_known
from softarm.estimator.fem.assembly import Body, build_body
from softarm.estimator.fem.elements.fibre import Membrane
from softarm.estimator.fem.elements.material import Material
from softarm.estimator.fem.linalg.cholesky import StiffnessFactor
from softarm.estimator.fem.loads import LoadSet, build_loads, superpose
from softarm.estimator.fem.parity.springs import Springs
from softarm.estimator.fem.sections import SectionFit, SectionFrame, SectionNodes, SectionPoses, build_section
from softarm.estimator.fem.statics.continuation import EquilibriumPath, between
from softarm.estimator.fem.statics.equilibrium import Balance, Settings, size_of, stable_factor, take_step
from softarm.estimator.fem.statics.solution import Solution
from softarm.estimator.mesh import Mesh
from softarm.estimator.model import Frames, Inputs, Load

# Some tens of terms meet in a nodal force, each rounded.
ROUNDING = 30.0 * np.finfo(float).eps


@dataclass(frozen=True)
class FiniteElementState:
    """A configuration of the arm.

    Args:
        displacement: Displacement of the nodes [m], shape (nodes, 3).
        inputs: Inputs it was brought to; load stepping starts from them.
    """

    displacement: Floats
    inputs: Inputs


@dataclass(frozen=True)
class FiniteElementStep:
    """The model linearised about a configuration; see ``softarm.estimator.model.Linearisation``.

    Args:
        displacement: Configuration [m], shape (nodes, 3).
        balance: Forces there.
        poses: Frames of the sections there.
        factor: Factor of the tangent, or of its positive definite stand-in; None when there is none.
    """

    model: "FiniteElementModel"
    displacement: Floats
    inputs: Inputs
    balance: Balance
    poses: SectionPoses
    factor: StiffnessFactor | None

    @property
    def frames(self) -> Frames:
        """Frames of the sections at the iterate."""
        return self.poses.frames

    @property
    def residual_norm(self) -> float:
        """Norm of the out-of-balance force over that of the applied forces; infinite when invalid."""
        return self.balance.norm if self.factor is not None else np.inf

    def input_forces(self) -> Floats:
        """Compute the forces per unit of each pressure, then each load, shape (inputs, 3 free)."""
        nodal = np.concatenate([self.balance.evaluation.gradients, self.balance.load_vectors])
        return self.model.body.pattern.gather(nodal)

    def input_fields(self) -> Floats:
        """Compute the displacement per unit of each pressure, then each load, shape (inputs, nodes, 3)."""
        assert self.factor is not None
        return self.model.body.pattern.scatter(self.factor.solve(self.input_forces()))

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; see ``Linearisation.response``."""
        on_free = self.model.body.pattern.gather(self.poses.pull_back(np.atleast_2d(rows)))
        # The adjoint, K^T y = J^T rows: one solve per row, whatever the number of inputs.
        adjoint = np.full_like(on_free, np.nan)
        if self.factor is not None:
            adjoint = self.factor.solve_transposed(on_free)
        return adjoint @ self.balance.residual, adjoint @ self.input_forces().T

    @cached_property
    def motions(self) -> Floats:
        """Linear displacements that the inputs, gravity and the stiffness factors make.

        Shape (1 + inputs + 3 + parameters, nodes, 3): what is left to equilibrium [m], then per unit of each
        pressure and load, of each component of gravity and of each factor.
        """
        body, mass = self.model.body, self.model.nodal_mass
        weights = body.pattern.gather(mass[:, None] * np.eye(3)[:, None, :])
        stiffness = body.pattern.gather(body.parameter_forces(body.points + self.displacement))
        forces = np.vstack([self.balance.residual, self.input_forces(), weights, -stiffness])
        if self.factor is None:
            return np.full((len(forces), *body.points.shape), np.nan)
        # The factor's refinement ends by the norm of all right-hand sides together.
        sizes = np.maximum(np.linalg.norm(forces, axis=1, keepdims=True), np.finfo(float).tiny)
        return body.pattern.scatter(sizes * self.factor.solve(forces / sizes))

    def full_response(self, rows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Project the motion of the sections on rows, with one solve for all that can change.

        It returns what ``sequential_batch.full_response`` does.
        """
        twists = np.atleast_2d(rows) @ self.poses.twists(self.motions).T
        inputs = self.model.chambers + len(self.model.loads)
        return (
            twists[:, 0],
            twists[:, 1 : 1 + inputs],
            twists[:, 1 + inputs : 4 + inputs],
            twists[:, 4 + inputs :],
        )


@dataclass(frozen=True)
class FiniteElementModel:
    """A soft arm as a finite-element body; implements ``softarm.estimator.model.ArmModel``.

    Build it with ``FiniteElementModel.build``. It is immutable: ``with_scales`` gives a changed copy that
    shares all that was precomputed.

    Args:
        mesh: Mesh at rest.
        body: Elements, fibres and chambers.
        frames: Section frames by name.
        nodal_mass: Mass of each node [kg], shape (nodes,).
        scales: Factor on the stiffness of each of ``parameters``.
        force_resolution: Out-of-balance force that rounding alone makes [N]; less is not required.
        settings: Limits of ``solve``.
    """

    mesh: Mesh
    body: Body
    frames: Mapping[str, SectionFrame]
    load_set: LoadSet
    nodal_mass: Floats
    scales: Floats
    force_resolution: float
    settings: Settings

    @classmethod
    def build(
        cls,
        mesh: Mesh,
        materials: Mapping[str, Material],
        chambers: Sequence[str] | None = None,
        fibres: Sequence[Membrane | Springs] = (),
        sections: Sequence[SectionNodes | str] = (),
        loads: Sequence[Load] = (),
        clamp: str = "clamp",
        nodal_mass: Floats | None = None,
        settings: Settings | None = None,
    ) -> "FiniteElementModel":
        """Build the model of a mesh.

        Args:
            mesh: Mesh at rest; nodes that no element uses are left out.
            materials: Material by region name; every region needs one.
            chambers: Names of the chambers' surfaces in the order of the pressures; when left out,
                ``chamber_0``, ``chamber_1`` and so on as far as the mesh has them.
            fibres: Membranes on named surfaces and discrete springs.
            sections: Rigid sections whose frames the model predicts; a bare name puts the frame's origin at
                the mean of the node set ``section_<name>``, axes along the base frame's.
            loads: Loads whose amplitudes are inputs; ``DistributedLoad`` among them for body forces.
            clamp: Node set that is held.
            nodal_mass: Mass of each node [kg], shape (nodes,); integrated from the densities when left out.
            settings: Limits of ``solve``.

        Raises:
            InputError: The mesh lacks a node set, surface or region that the arguments name, an element is
                inverted, a chamber is open, or a load lies outside the body.
        """
        if clamp not in mesh.node_sets or not len(mesh.node_sets[clamp]):
            node_sets = ", ".join(mesh.node_sets)
            raise InputError(
                "mesh", f"it has no node set {clamp!r}", f"name the held nodes (it has {node_sets})"
            )
        names = _chambers(mesh) if chambers is None else tuple(chambers)
        body = build_body(mesh, materials, names, fibres, mesh.node_sets[clamp])
        listed = [SectionNodes(section) if isinstance(section, str) else section for section in sections]
        frames = {section.name: build_section(mesh, section) for section in listed}
        densities = np.array([materials[name].density for name in mesh.regions])
        return cls(
            mesh=mesh,
            body=body,
            frames=frames,
            load_set=build_loads(mesh, tuple(loads), frames),
            nodal_mass=body.nodal_mass(densities) if nodal_mass is None else np.array(nodal_mass),
            scales=np.ones(len(body.parameters)),
            force_resolution=_force_resolution(body),
            settings=settings or Settings(),
        )

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose frames it predicts."""
        return tuple(self.frames)

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return self.body.chambers

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return self.load_set.loads

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the stiffness factors: regions, then fibres."""
        return self.body.parameters

    def with_scales(self, scales: Mapping[str, float]) -> "FiniteElementModel":
        """Copy the model with other stiffness factors for some of ``parameters``; nothing is analysed anew.

        Raises:
            InputError: A name is unknown or a factor is not positive.
        """
        values = self.scales.copy()
        for name, value in scales.items():
            require_known("scales", "parameter", name, self.parameters)
            if not value > 0.0:
                raise InputError("scales", f"{name} = {value} is not positive", "give a factor above 0")
            values[self.parameters.index(name)] = value
        return replace(self, scales=values)

    def without_snaps(self) -> "FiniteElementModel":
        """Copy the model so that a load path ends where the arm would snap through.

        For a calibration: the arm was not recorded in states beyond, and they take long to find.
        """
        return replace(self, settings=replace(self.settings, descent=0, smallest_step=0.02))

    def with_loads(self, loads: Sequence[Load]) -> "FiniteElementModel":
        """Copy the model with other loads; nothing is analysed anew."""
        return replace(self, load_set=build_loads(self.mesh, tuple(loads), dict(self.frames)))

    def no_inputs(self) -> Inputs:
        """Return inputs that are all zero."""
        return Inputs(np.zeros(self.chambers), np.zeros(len(self.loads)), np.zeros(3))

    def rest(self) -> FiniteElementState:
        """Return the unloaded state."""
        return FiniteElementState(np.zeros_like(self.body.points), self.no_inputs())

    def balance(self, displacement: Floats, inputs: Inputs, tangent: bool = True) -> Balance:
        """Evaluate the forces at a displacement of the nodes [m], shape (nodes, 3), under given inputs.

        The tangent is the derivative of (internal - pressure forces); loads that rotate are no part of it.
        """
        positions = self.body.points + displacement
        evaluation = self.body.evaluate(positions, inputs.pressures, self.scales, tangent=tangent)
        vectors = self.load_set.vectors(positions)
        fields = np.empty((3, *positions.shape))
        fields[0] = superpose(inputs.pressures, evaluation.gradients)
        fields[1] = superpose(inputs.loads, vectors) + self.nodal_mass[:, None] * inputs.gravity
        fields[2] = evaluation.forces
        pushed, loaded, internal = self.body.pattern.gather(fields)
        residual = pushed + loaded - internal
        # Not the norm of the sum: where pressure and load cancel, the residual would be compared with
        # nothing.
        applied = np.hypot(np.linalg.norm(pushed), np.linalg.norm(loaded))
        # Without any load, rounding is all there is to compare with.
        applied = max(float(applied), self.force_resolution / self.settings.tolerance)
        norm = float(np.linalg.norm(residual) / applied) if evaluation.valid else np.inf
        return Balance(evaluation, residual, vectors, norm)

    def refreshed(self, state: FiniteElementState) -> FiniteElementState:
        """Return a state: it holds nothing of earlier linearisations."""
        return state

    def linearise(self, state: FiniteElementState, inputs: Inputs) -> FiniteElementStep:
        """Linearise about a state under given inputs."""
        balance, factor = stable_factor(self.body, self.balance, state.displacement, inputs)
        poses = self.section_fit.at(self.body.points + state.displacement)
        return FiniteElementStep(self, state.displacement, inputs, balance, poses, factor)

    def advance(self, step: FiniteElementStep, change: Floats) -> FiniteElementState:
        """Take the Newton step for inputs changed by ``change`` (pressures, then loads).

        A step that would invert an element or move a node by more than ``settings.longest_move`` of the
        body's size is shortened; the next residual shows it.
        """
        pressures = step.inputs.pressures + change[: self.chambers]
        inputs = Inputs(pressures, step.inputs.loads + change[self.chambers :], step.inputs.gravity)
        if step.factor is None:
            return FiniteElementState(step.displacement, inputs)
        force = step.balance.residual + change @ step.input_forces()
        move = self.body.pattern.scatter(step.factor.solve(force))
        return self.displace(FiniteElementState(step.displacement, inputs), move, inputs)

    def displace(self, state: FiniteElementState, move: Floats, inputs: Inputs) -> FiniteElementState:
        """Move a state by a linear displacement [m], shape (nodes, 3), and put it under other inputs.

        A displacement that is too large for a Newton step is shortened like one.
        """
        reach = self.settings.longest_move * size_of(self.body)
        after = take_step(self.body, self.balance, state.displacement, move, inputs, reach)
        return FiniteElementState(after, inputs)

    def solve(self, inputs: Inputs, start: FiniteElementState) -> tuple[FiniteElementState, bool]:
        """Find the equilibrium under fixed inputs; the flag is true when it converged."""
        solution = self.equilibrium(inputs, start)
        return solution.value, solution.converged

    def equilibrium(
        self, inputs: Inputs, start: FiniteElementState | None = None
    ) -> Solution[FiniteElementState]:
        """Find the equilibrium under fixed inputs, setting out from a state, best one in equilibrium itself.

        Returns:
            The state, how the solve ended, the linear solves it took and its residual.
        """
        start = start or self.rest()
        path = EquilibriumPath(self.body, self.balance, start.inputs, inputs, self.nodal_mass, self.settings)
        walked = path.walk(start.displacement)
        # A path that ended early stands at its last equilibrium, with the inputs of that one.
        reached = inputs if walked.converged else between(start.inputs, inputs, path.fraction)
        state = FiniteElementState(walked.value, reached)
        return Solution(state, walked.status, walked.iterations, walked.residual_norm)

    @cached_property
    def section_fit(self) -> SectionFit:
        """The fit of all sections' frames at once."""
        return SectionFit.of(tuple(self.frames.values()), len(self.body.points))

    def section_frames(self, state: FiniteElementState) -> Frames:
        """Compute the sections' frames in a state."""
        return self.section_fit.at(self.body.points + state.displacement).frames

    def energy_and_stress(self, state: FiniteElementState) -> tuple[Floats, Floats]:
        """Compute each element's strain energy per volume [J/m3] and von Mises stress [Pa]."""
        return self.body.energy_and_stress(self.body.points + state.displacement, self.scales)


def _force_resolution(body: Body) -> float:
    """Estimate the rounding error of the residual: nodal stiffness times size times unit rounding."""
    none, ones = np.zeros(body.chambers), np.ones(len(body.parameters))
    tangent = body.evaluate(body.points, none, ones).tangent
    assert tangent is not None
    # The first block of a column is the one on the diagonal.
    stiffness = np.linalg.norm(np.trace(tangent.values[body.pattern.column_start[:-1]], axis1=1, axis2=2))
    return float(ROUNDING * stiffness * size_of(body))


def _chambers(mesh: Mesh) -> tuple[str, ...]:
    names: list[str] = []
    while f"chamber_{len(names)}" in mesh.surfaces:
        names.append(f"chamber_{len(names)}")
    return tuple(names)

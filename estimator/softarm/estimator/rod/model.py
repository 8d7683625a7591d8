"""The calibrated rod as a model of the arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError, require_known
from softarm.estimator.model import Frames, Inputs, Load
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.rod.arrays import ChainInputs, CompiledChain, Laws, Work, new_work
from softarm.estimator.rod.balance import respond, respond_all
from softarm.estimator.rod.chain import Chain

TOLERANCE, COARSE = 1e-6, 1e-4
"""Gap of a strain [rad, share of a link's length] that one more Newton step closes to about its square; the
larger where only the response is wanted."""
SHARES = ((3, 0), (4, 1), (5, 2), (2, 5))
"""Component of the wrench and strain it makes, for each eigenstrain: two bends, the twist, the elongation."""
TWIST_TERM = (0, 0, 0, 6)
"""Term of a link law that stands for the moment about the arm's axis."""
CONTINUATION = (1, 4, 16, 64)
"""Numbers of load steps that ``solve`` tries in turn."""


@dataclass(frozen=True)
class RodStep:
    """The rod at the equilibrium under its inputs; see ``softarm.estimator.model.Linearisation``.

    Args:
        strain: Strains of the links, shape (links, 6).
        frames: Frames of the sections.
        motion: Section twists per unit of each pressure, then each load, shape (6 sections, inputs).
        change: Change of the strains per unit of each, shape (6 links, inputs).
        residual_norm: 0 in equilibrium, infinite where none was found.
        iterations: Linearisations that it took.
    """

    inputs: Inputs
    strain: Floats
    frames: Frames
    motion: Floats
    change: Floats
    residual_norm: float
    iterations: int

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; nothing drifts in equilibrium."""
        return np.zeros(len(rows)), rows @ self.motion


@dataclass(frozen=True)
class CalibratedRod:
    """A Cosserat rod whose link laws were fitted to a finite-element model; implements ``ArmModel``.

    Every state it returns is in equilibrium. Its state is the array of strains, shape (links, 6).

    Args:
        chain: Rest geometry.
        laws: Link laws; ``laws.stiffness`` holds the stiffness factors.
        loads: Loads whose amplitudes are inputs.
    """

    chain: Chain
    laws: Laws
    loads: tuple[Load, ...]

    takes_eigenstrains = True

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose frames it predicts."""
        return self.chain.sections

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return self.chain.chamber_count

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions whose stiffness can be scaled."""
        return tuple(dict.fromkeys(self.chain.regions))

    @property
    def factors(self) -> Floats:
        """Stiffness factor of each region, shape (regions,)."""
        first = [self.chain.regions.index(name) for name in self.regions]
        return np.asarray(self.laws.stiffness[first], dtype=np.float64)

    def with_loads(self, loads: Sequence[Load]) -> "CalibratedRod":
        """Copy the rod with other loads, anywhere along it."""
        return replace(self, loads=tuple(loads))

    def with_scales(self, scales: Mapping[str, float]) -> "CalibratedRod":
        """Copy the rod with other stiffness factors of some regions; nothing is fitted anew.

        Strain depends on wrench / E and pressure / E, exactly so where all that is elastic in a region
        (fibres included) is scaled alike.

        Raises:
            InputError: If a region is unknown or a factor is not positive.
        """
        factors = self.laws.stiffness.copy()
        for name, factor in scales.items():
            require_known("scales", "region", name, self.regions)
            if not factor > 0.0:
                raise InputError("scales", f"{name} = {factor:g} is not positive", "give a factor above 0")
            factors[[region == name for region in self.chain.regions]] = factor
        return replace(self, laws=self.laws._replace(stiffness=factors))

    def with_compliances(
        self, torsion: Mapping[str, float], extension: Mapping[str, float]
    ) -> "CalibratedRod":
        """Return a rod whose regions twist and lengthen by a further share.

        Args:
            torsion: Share by which a region twists further under a moment about the arm's axis.
            extension: Share by which a region lengthens further, under forces and pressures.
        """
        coefficients = self.laws.coefficients.copy()
        twist = (self.laws.table == TWIST_TERM).all(axis=1)
        for link, region in enumerate(self.chain.regions):
            coefficients[link, twist, 2] *= 1.0 + torsion.get(region, 0.0)
            coefficients[link, :, 5] *= 1.0 + extension.get(region, 0.0)
        return replace(self, laws=self.laws._replace(coefficients=coefficients))

    def rest(self) -> Floats:
        """Return the unloaded state."""
        return np.zeros((self.chain.links, 6))

    def refreshed(self, state: Floats) -> Floats:
        """Return a state: it holds nothing of earlier linearisations."""
        return state

    def section_frames(self, state: Floats) -> Frames:
        """Compute the sections' frames in a state."""
        chain, stations = self.chain, self.chain.station_frames(state)
        rotated = stations.rotations[chain.section_station]
        moved = (rotated @ chain.section_offset[:, :, None])[..., 0]
        return Frames(stations.positions[chain.section_station] + moved, rotated @ chain.section_rotation)

    def linearise(self, state: Floats, inputs: Inputs) -> RodStep:
        """Find the equilibrium under inputs near a state and linearise there."""
        drive = self._drive(inputs)
        work = self._work(state)
        sections = len(self.sections)
        columns = self.chambers + len(self.loads)
        places, twists = np.empty((sections, 3)), np.zeros((6 * sections, columns))
        change = np.zeros((6 * self.chain.links, columns))
        count, _ = respond(self._compiled, drive, TOLERANCE, work, places, change, twists)
        rotations = work.rotations[self.chain.section_station] @ self.chain.section_rotation
        residual = 0.0 if count > 0 else np.inf
        return RodStep(inputs, work.strain, Frames(places, rotations), twists, change, residual, abs(count))

    def advance(self, step: RodStep, change: Floats) -> Floats:
        """Carry the strains along their tangent for inputs changed by ``change``."""
        state: Floats = step.strain + (step.change @ change).reshape(-1, 6)
        return state

    def solve(self, inputs: Inputs, start: Floats) -> tuple[Floats, bool]:
        """Find the equilibrium, directly or along the way from rest; the flag is true when it was found."""
        step = self.linearise(start, inputs)
        if step.residual_norm == 0.0:
            return step.strain, True
        for steps in CONTINUATION:
            state, linearisation = self._from_rest(inputs, steps)
            if linearisation:
                return state, True
        return start, False

    def evaluate(
        self, inputs: BatchInputs, *, start: ArmResponse | None = None, jacobians: bool = True
    ) -> ArmResponse:
        """Solve many samples in one compiled loop; see ``BatchArmModel.evaluate``.

        Without ``start`` each sample begins from the one before.
        """
        samples, sections, links = len(inputs), len(self.sections), self.chain.links
        columns = self.chambers + len(self.loads) + 3
        places = np.empty((samples, sections, 3))
        rotations = np.empty((samples, sections, 3, 3))
        strains = np.full((samples, links, 6), np.nan)
        if start is not None:
            # A state that is no equilibrium would begin worse than that of the sample before.
            strains = np.where(start.converged[:, None, None], start.states, np.nan)
        ways = self._shapes.shape[1]
        width = columns + links + ways if jacobians else 0
        sizes = np.zeros((samples, ways))
        if inputs.eigenstrains is not None:
            sizes = _dense(inputs.eigenstrains).reshape(samples, ways)
        twists = np.zeros((samples, 6 * sections, width))
        counts = np.zeros(samples, dtype=np.int64)
        respond_all(
            self._compiled_with_gravity, _dense(inputs.pressures), _dense(inputs.loads),
            _dense(np.broadcast_to(inputs.gravity, (samples, 3))), sizes, TOLERANCE if jacobians else COARSE,
            self._work(self.rest()), strains, places, rotations, twists, counts,
        )  # fmt: skip
        by_link = twists[..., columns : columns + links]
        # The chain rule converts a derivative by the factor into one by its logarithm.
        by_region = by_link @ (self._membership * self.factors) if jacobians else by_link
        return ArmResponse(
            Frames(places, rotations @ self.chain.section_rotation),
            counts > 0,
            self.chambers,
            twists[..., :columns],
            by_region,
            twists[..., columns + links :],
            states=strains,
        )

    def _from_rest(self, inputs: Inputs, steps: int) -> tuple[Floats, bool]:
        step = self.linearise(
            self.rest(), Inputs(0.0 * inputs.pressures, 0.0 * inputs.loads, 0.0 * inputs.gravity)
        )
        vector = np.concatenate([inputs.pressures, inputs.loads])
        for k in range(1, steps + 1):
            part = k / steps
            here = Inputs(part * inputs.pressures, part * inputs.loads, part * inputs.gravity)
            # `advance` ignores gravity; the solve at the new inputs adds its share.
            step = self.linearise(self.advance(step, vector / steps), here)
            if step.residual_norm > 0.0:
                return step.strain, False
        return step.strain, True

    def _drive(self, inputs: Inputs) -> ChainInputs:
        links = self.chain.links
        force, couple = np.zeros((links + len(self.loads), 3)), np.zeros((links + len(self.loads), 3))
        force[:links] = self.chain.mass[:, None] * inputs.gravity
        sized = np.asarray(inputs.loads)[:, None]
        force[links:] = sized * self._directions[:, :3]
        couple[links:] = sized * self._directions[:, 3:]
        return ChainInputs(_dense(inputs.pressures), force, couple, self.rest())

    def _work(self, strain: Floats) -> Work:
        work = new_work(self.chain.links, self.chain.links + len(self.loads), self.laws.chambers.shape[1])
        work.positions[0, 2] = self.chain.heights[0]
        work.strain[:] = strain
        return work

    @cached_property
    def _directions(self) -> Floats:
        """Force and couple of each load per unit, none for a load on the clamp, shape (loads, 6)."""
        directions = np.zeros((len(self.loads), 6))
        for k, load in enumerate(self.loads):
            if self.chain.place(load)[0] >= 0:
                directions[k, slice(0, 3) if load.kind == "force" else slice(3, 6)] = load.direction
        return directions

    @cached_property
    def _compiled(self) -> CompiledChain:
        """The chain with pressures and loads for inputs."""
        chain, index = self.chain, np.arange(len(self.loads))
        owner = np.stack([chain.links + index, self.chambers + index], axis=1).astype(np.int64)
        return CompiledChain(
            chain.lengths, chain.actions(self.loads), self.laws, self.chambers + len(self.loads),
            self._directions, owner, self._shapes, chain.section_station, chain.section_offset,
        )  # fmt: skip

    @cached_property
    def _compiled_with_gravity(self) -> CompiledChain:
        """The chain with the components of gravity among its inputs, after pressures and loads."""
        plain, links = self._compiled, self.chain.links
        weights = np.zeros((3 * links, 6))
        whose = np.zeros((3 * links, 2), dtype=np.int64)
        for axis in range(3):
            rows = slice(axis * links, (axis + 1) * links)
            weights[rows, axis] = self.chain.mass
            whose[rows] = np.stack([np.arange(links), np.full(links, plain.inputs + axis)], axis=1)
        units, owner = np.concatenate([plain.units, weights]), np.concatenate([plain.owner, whose])
        return plain._replace(inputs=plain.inputs + 3, units=units, owner=owner)

    @cached_property
    def _shapes(self) -> Floats:
        """Strains of the links per unit of each region's eigenstrains, shape (6 links, 4 regions).

        Links share them as they share the strain under an even bending moment, torque or axial force.
        """
        shapes = np.zeros((self.chain.links, 6, len(self.regions), 4))
        for kind, (wrench, strain) in enumerate(SHARES):
            # The law's linear term in this component: the link's compliance.
            row = np.flatnonzero((self.laws.table == (0, 0, 0, 1 + wrench)).all(axis=1))[0]
            compliance = np.abs(self.laws.coefficients[:, row, strain]) / self.laws.scale[:, wrench]
            columns = compliance[:, None] * self._membership
            # Shares of a region's links sum to one, so that a unit eigenstrain bends the whole region by one.
            shapes[:, strain, :, kind] = columns / np.maximum(columns.sum(axis=0), 1e-300)
        return shapes.reshape(6 * self.chain.links, -1)

    @cached_property
    def _membership(self) -> Floats:
        """Which links belong to each region, shape (links, regions)."""
        return np.array([[float(region == name) for name in self.regions] for region in self.chain.regions])


def _dense(values: Floats) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)

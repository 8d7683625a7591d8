"""The finite-element model that follows an arm in time: the factor is reused until it stops serving."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.background import Background
from softarm.estimator.fem.loads import superpose
from softarm.estimator.fem.model import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.sections import SectionPoses
from softarm.estimator.fem.statics.equilibrium import Balance
from softarm.estimator.fem.tracking.frozen_tangent import FrozenTangent, freeze_tangent
from softarm.estimator.fem.tracking.rotation_strain import SingleRotationStrain
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.wrapper import ModelWrapper


class BackgroundFactorisation(Background[tuple[Floats, Inputs], FrozenTangent | None]):
    """Factors the latest requested configuration; the kernels run without the interpreter's lock.

    Args:
        model: Model whose tangent is factored.
        single: As for ``freeze_tangent``.
    """

    def __init__(self, model: FiniteElementModel, *, single: bool = True) -> None:
        super().__init__(self._freeze, "factorisation")
        self._model, self._single = model, single

    def _freeze(self, configuration: tuple[Floats, Inputs]) -> FrozenTangent | None:
        """Factor; where the tangent has no factor the last one stays."""
        return freeze_tangent(self._model, *configuration, single=self._single) or self.newest


NEGLIGIBLE = 1.0
"""Residual over the tolerance below which nothing is corrected."""
UNBALANCED = 4
"""So many steps with an old factor cost as much as a new one (``softarm bench step``): if the body is still
out of balance after them, the factor is renewed."""
CORRECTING_RAD = 1e-3
"""Rotation of a section through changed inputs up to which a step counts as a correction."""


class RotationStrainUpdate(Protocol):
    """Carries steps between configurations, as ``SingleRotationStrain`` and ``RotationStrain`` do."""

    def deformation(self, displacement: Floats) -> Any:
        """Compute the deformation gradients of a displacement, shape (nodes, 3)."""

    def rotations(self, before: Any, after: Any) -> Any:
        """Compute the rotations between configurations with given deformation gradients."""

    def solve_poisson(self, nodal: Floats) -> Floats:
        """Solve the Poisson problem for nodal values, shape (nodes, columns)."""

    def corotated_divergence(self, rotations: Any, nodal: Floats) -> Floats:
        """Compute the divergence of the gradient of a displacement carried along, shape (nodes, 3)."""

    def pulled_back(self, rotations: Any, forces: Floats) -> Floats:
        """Carry nodal forces back, shape (nodes, 3)."""

    def moved(self, displacement: Floats, deformation: Any, step: Floats, rotations: Any) -> Floats:
        """Move by a linear step, its spin taken as a finite rotation, shape (nodes, 3)."""


@dataclass(frozen=True)
class TrackingState:
    """A configuration, and the factor with which it was reached.

    Args:
        displacement: Displacement of the nodes [m], shape (nodes, 3).
        inputs: Inputs it was brought to.
        tangent: The factor; None before the first linearisation.
        forces: Norm of the forces that the last correcting step was to balance [N].
        unbalanced: Number of steps in a row with this factor that left the body out of balance.
    """

    displacement: Floats
    inputs: Inputs
    tangent: FrozenTangent | None = None
    forces: float = np.inf
    unbalanced: int = 0


@dataclass(frozen=True)
class TrackingStep:
    """The model linearised with a factor that may be of another configuration.

    The factor is carried along with the material. The residual and the frames are exact, so what an iteration
    converges to is exact; only its path and the sensitivities feel the factor's age.

    Args:
        tracking: The model.
        state: Configuration.
        balance: Forces there, without tangent.
        poses: Frames of the sections there.
        tangent: The factor; None where the configuration is invalid.
    """

    tracking: "TrackingModel"
    state: TrackingState
    inputs: Inputs
    balance: Balance
    poses: SectionPoses
    tangent: FrozenTangent | None

    @property
    def model(self) -> FiniteElementModel:
        """The finite-element model."""
        return self.tracking.model

    @property
    def frames(self) -> Frames:
        """Frames of the sections at the iterate."""
        return self.poses.frames

    @property
    def residual_norm(self) -> float:
        """Norm of the out-of-balance force over that of the applied forces; infinite when invalid."""
        return self.balance.norm if self.tangent is not None else np.inf

    @cached_property
    def deformation(self) -> Any:
        """Deformation gradients, a field of the rotation-strain update."""
        return self.tracking.rotation_strain.deformation(self.state.displacement)

    @cached_property
    def rotations(self) -> Any:
        """Rotations since the tangent was frozen, a field of the rotation-strain update."""
        assert self.tangent is not None
        strain_update = self.tracking.rotation_strain
        return strain_update.rotations(strain_update.deformation(self.tangent.displacement), self.deformation)

    @cached_property
    def correction(self) -> Floats:
        """The Newton step at unchanged inputs, where the tangent was frozen, shape (nodes, 3)."""
        assert self.tangent is not None
        pattern = self.model.body.pattern
        if self.balance.norm < NEGLIGIBLE * self.model.settings.tolerance:
            return np.zeros_like(self.state.displacement)
        forces = self.tracking.rotation_strain.pulled_back(
            self.rotations, pattern.scatter(self.balance.residual)
        )
        return pattern.scatter(self.tangent.factor.solve(pattern.gather(forces)))

    @cached_property
    def _twists(self) -> tuple[Floats, Floats]:
        """Change of the twists of all sections through the Newton step and per unit of each input."""
        sections = len(self.poses.since_rest)
        if self.tangent is None:
            inputs = self.model.chambers + len(self.model.loads)
            return np.full(6 * sections, np.nan), np.full((6 * sections, inputs), np.nan)
        drift = np.zeros(6 * sections)
        if self.correction.any():
            strain_update = self.tracking.rotation_strain
            divergence = strain_update.corotated_divergence(self.rotations, self.correction)
            # The sections need a few moments of the carried step, which are linear in its divergence: no
            # Poisson problem is solved for them.
            moments = self.tracking.moments_of_divergence @ divergence
            drift = self.poses.twists_of_moments(moments[None])[0]
        # Sensitivities were computed with the factor; those of each section have rotated with it since.
        since = self.frames.rotations @ self.tangent.sections.transpose(0, 2, 1)
        motion = self.tangent.motion.reshape(sections, 2, 3, -1)
        return drift, np.einsum("sij,stjr->stir", since, motion).reshape(6 * sections, -1)

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; see ``Linearisation.response``."""
        drift, motion = self._twists
        return rows @ drift, rows @ motion

    def rotation(self, change: Floats) -> float:
        """Compute the largest angle by which changed inputs rotate a section [rad]."""
        _, motion = self._twists
        rotations = (motion @ change).reshape(-1, 2, 3)[:, 1]
        return float(np.linalg.norm(rotations, axis=-1).max(initial=0.0))

    def forces(self, change: Floats) -> float:
        """Compute the norm of the forces that the Newton step for changed inputs is to balance [N]."""
        evaluation, chambers = self.balance.evaluation, self.model.chambers
        pushed = superpose(change[:chambers], evaluation.gradients)
        loaded = superpose(change[chambers:], self.balance.load_vectors)
        return float(np.linalg.norm(self.balance.residual + self.model.body.pattern.gather(pushed + loaded)))

    def moved(self, change: Floats) -> Floats:
        """Compute the displacement after the Newton step for changed inputs [m], shape (nodes, 3)."""
        assert self.tangent is not None
        step = self.correction + superpose(change, self.tangent.fields)
        return self.tracking.rotation_strain.moved(
            self.state.displacement, self.deformation, step, self.rotations
        )


@dataclass(frozen=True)
class TrackingModel(ModelWrapper):
    """A finite-element model whose linearisations reuse the factor; an ``ArmModel``.

    A factor is replaced by the newest one from the background, or by a fresh one on the spot where it
    contracts the residual by less than ``contraction`` or leaves the body out of balance for long.

    Args:
        background: Factors in the background, started and stopped by the caller; None for no background.
        contraction: Residual after a step over the forces it was to balance, from which on the factor is
            renewed.
        slowing: Likewise, from which on a fresh factor is requested in the background. A body whose residual
            over the applied forces is more is out of balance.
        strain_update: Carries steps along with the material; built in single precision when left out.
        single: Whether factors taken on the spot are kept in single precision.
    """

    model: FiniteElementModel
    background: BackgroundFactorisation | None = None
    contraction: float = 0.5
    slowing: float = 0.05
    strain_update: RotationStrainUpdate | None = None
    single: bool = True

    @cached_property
    def rotation_strain(self) -> RotationStrainUpdate:
        """What carries steps along with the material."""
        return self.strain_update or SingleRotationStrain.of(self.model.body)

    @cached_property
    def moments_of_divergence(self) -> Floats:
        """Moments of the sections per value of a carried step's divergence, shape (4 sections, nodes)."""
        # The Poisson matrix is symmetric, so that its inverse may be applied to the moments' weights instead.
        return self.rotation_strain.solve_poisson(np.ascontiguousarray(self.model.section_fit.weights.T)).T

    def rest(self) -> TrackingState:
        """Return the unloaded state."""
        state = self.model.rest()
        return TrackingState(state.displacement, state.inputs)

    def section_frames(self, state: TrackingState) -> Frames:
        """Compute the sections' frames in a state."""
        return self.model.section_fit.at(self.model.body.points + state.displacement).frames

    def refreshed(self, state: TrackingState) -> TrackingState:
        """Return a state without the factor with which it was reached."""
        return TrackingState(state.displacement, state.inputs)

    def linearise(self, state: TrackingState, inputs: Inputs) -> TrackingStep:
        """Linearise about a state under given inputs."""
        balance = self.model.balance(state.displacement, inputs, tangent=False)
        poses = self.model.section_fit.at(self.model.body.points + state.displacement)
        tangent = self._tangent(state, inputs, balance) if balance.evaluation.valid else None
        return TrackingStep(self, state, inputs, balance, poses, tangent)

    def _tangent(self, state: TrackingState, inputs: Inputs, balance: Balance) -> FrozenTangent | None:
        # Where the last step was for new inputs, its residual does not judge the factor.
        held, arrived = state.tangent, not np.isfinite(state.forces)
        # Another gravity is a jump of the forces that no factor is to blame for.
        moved_on = not np.array_equal(inputs.gravity, state.inputs.gravity)
        residual = float(np.linalg.norm(balance.residual))
        calm = arrived or moved_on or balance.norm < self.model.settings.tolerance
        slow = not calm and residual >= self.contraction * state.forces
        slow |= state.unbalanced >= UNBALANCED and balance.norm > self.slowing
        nearest = held
        if self.background is not None:
            if held is None or moved_on or (not calm and residual >= self.slowing * state.forces):
                self.background.ask((state.displacement, inputs))
            # Another factor has other sensitivities and so another optimum: none is swapped near the end.
            if held is None or arrived or slow:
                nearest = _nearer(state.displacement, held, self.background.newest)
        if nearest is not None and (not slow or nearest is not held):
            return nearest
        return freeze_tangent(self.model, state.displacement, inputs, single=self.single)

    def advance(self, step: TrackingStep, change: Floats) -> TrackingState:
        """Take the Newton step for inputs changed by ``change`` (pressures, then loads)."""
        pressures = step.inputs.pressures + change[: self.chambers]
        inputs = Inputs(pressures, step.inputs.loads + change[self.chambers :], step.inputs.gravity)
        if step.tangent is None:
            return replace(step.state, inputs=inputs)
        displacement = step.moved(change)
        # A step for new inputs rotates the body: its residual is due to the nonlinearity, not to the factor.
        forces = step.forces(change) if step.rotation(change) <= CORRECTING_RAD else np.inf
        again = step.tangent is step.state.tangent and step.residual_norm > self.slowing
        return TrackingState(
            displacement, inputs, step.tangent, forces, step.state.unbalanced + 1 if again else 0
        )

    def solve(self, inputs: Inputs, start: TrackingState) -> tuple[TrackingState, bool]:
        """Find the equilibrium under fixed inputs; the flag is true when it converged."""
        state, converged = self.model.solve(inputs, FiniteElementState(start.displacement, start.inputs))
        return TrackingState(state.displacement, state.inputs, start.tangent), converged


def _nearer(
    displacement: Floats, held: FrozenTangent | None, other: FrozenTangent | None
) -> FrozenTangent | None:
    """Choose the factor that was taken nearer to a configuration."""
    if held is None or other is None:
        return held or other
    away = [np.linalg.norm(displacement - one.displacement) for one in (held, other)]
    return other if away[1] < away[0] else held

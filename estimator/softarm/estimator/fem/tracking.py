"""The finite-element model for following an arm in time: the factor is reused until it stops serving."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.fem.background import Refactoriser
from softarm.estimator.fem.equilibrium import Balance
from softarm.estimator.fem.loads import superpose
from softarm.estimator.fem.model import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.section_fit import Fitted
from softarm.estimator.fem.stiffness import Stiffness, take_stiffness
from softarm.estimator.mesh import Floats, Singles
from softarm.estimator.model import Frames, Inputs, Load

NEGLIGIBLE = 1.0
"""Residual over the tolerance below which nothing is corrected."""
CORRECTING_RAD = 1e-3
"""Turn of a section through changed inputs up to which a step counts as a correction."""


@dataclass(frozen=True)
class TrackingState:
    """A configuration, and the factor with which it was reached.

    Args:
        displacement: Displacement of the nodes [m], shape (nodes, 3).
        inputs: Inputs it was brought to.
        stiffness: The factor; None before the first linearisation.
        forces: Norm of the forces that the last correcting step was to balance [N].
    """

    displacement: Floats
    inputs: Inputs
    stiffness: Stiffness | None = None
    forces: float = np.inf


@dataclass(frozen=True)
class TrackingStep:
    """The model linearised with a factor that may be of another configuration.

    The factor is carried along with the material. The residual and the frames are exact, so what an iteration
    converges to is exact; only its path and the sensitivities feel the factor's age.

    Args:
        model: The model.
        state: Configuration.
        inputs: Inputs.
        balance: Forces there, without tangent.
        fitted: Frames of the sections there.
        stiffness: The factor; None where the configuration is invalid.
    """

    model: FiniteElementModel
    state: TrackingState
    inputs: Inputs
    balance: Balance
    fitted: Fitted
    stiffness: Stiffness | None

    @property
    def frames(self) -> Frames:
        """Frames of the sections at the iterate."""
        return self.fitted.frames

    @property
    def residual_norm(self) -> float:
        """Norm of the out-of-balance force over that of the applied forces; infinite when invalid."""
        return self.balance.norm if self.stiffness is not None else np.inf

    @cached_property
    def deformation(self) -> Singles:
        """Deformation gradients, a field of ``Transport``."""
        return self.model.body.transport.deformation(self.state.displacement)

    @cached_property
    def turns(self) -> Singles:
        """Rotations since the factor was taken, a field of ``Transport``."""
        assert self.stiffness is not None
        return self.model.body.transport.turns(self.stiffness.inverse, self.deformation)

    @cached_property
    def correction(self) -> Floats:
        """The Newton step at unchanged inputs, where the factor was taken, shape (nodes, 3)."""
        assert self.stiffness is not None
        body = self.model.body
        if self.balance.norm < NEGLIGIBLE * self.model.settings.tolerance:
            return np.zeros_like(self.state.displacement)
        forces = body.transport.forces_back(self.turns, body.pattern.scatter(self.balance.residual))
        return body.pattern.scatter(self.stiffness.factor.solve(body.pattern.gather(forces)))

    @cached_property
    def _twists(self) -> tuple[Floats, Floats]:
        """Change of the twists of all sections through the Newton step and per unit of each input."""
        sections = len(self.fitted.turns)
        if self.stiffness is None:
            inputs = self.model.chambers + len(self.model.loads)
            return np.full(6 * sections, np.nan), np.full((6 * sections, inputs), np.nan)
        drift = np.zeros(6 * sections)
        if self.correction.any():
            transport = self.model.body.transport
            step = transport.carried(self.turns, self.correction)
            drift = self.fitted.twists((self.model.section_fit.of_divergence @ step)[None])[0]
        since = self.frames.rotations @ self.stiffness.sections.transpose(0, 2, 1)
        motion = self.stiffness.motion.reshape(sections, 2, 3, -1)
        return drift, np.einsum("sij,stjr->stir", since, motion).reshape(6 * sections, -1)

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; see ``Linearisation.response``."""
        drift, motion = self._twists
        return rows @ drift, rows @ motion

    def turn(self, change: Floats) -> float:
        """Give the largest angle by which changed inputs turn a section [rad]."""
        _, motion = self._twists
        turns = (motion @ change).reshape(-1, 2, 3)[:, 1]
        return float(np.linalg.norm(turns, axis=-1).max(initial=0.0))

    def forces(self, change: Floats) -> float:
        """Give the norm of the forces that the Newton step for changed inputs is to balance [N]."""
        evaluation, chambers = self.balance.evaluation, self.model.chambers
        pushed = superpose(change[:chambers], evaluation.gradients)
        loaded = superpose(change[chambers:], self.balance.load_vectors)
        return float(np.linalg.norm(self.balance.residual + self.model.body.pattern.gather(pushed + loaded)))

    def moved(self, change: Floats) -> Floats:
        """Give the displacement after the Newton step for changed inputs [m], shape (nodes, 3)."""
        assert self.stiffness is not None
        transport = self.model.body.transport
        step = self.correction + superpose(change, self.stiffness.fields)
        return transport.moved(self.state.displacement, self.deformation, step, self.turns)


@dataclass(frozen=True)
class TrackingModel:
    """A finite-element model whose linearisations reuse the factor; an ``ArmModel``.

    A factor is replaced by the newest one from the background, or, where it contracts the residual by less
    than ``contraction``, by a fresh one on the spot.

    Args:
        model: The model.
        background: Who factors in the background, started and stopped by the caller; None for nobody.
        contraction: Residual after a step over the forces it was to balance, from which on the factor is
            renewed.
        slowing: Likewise, from which on a fresh factor is asked for in the background.
    """

    model: FiniteElementModel
    background: Refactoriser | None = None
    contraction: float = 0.5
    slowing: float = 0.05

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose frames it gives."""
        return self.model.sections

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return self.model.chambers

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return self.model.loads

    def rest(self) -> TrackingState:
        """Give the unloaded state."""
        state = self.model.rest()
        return TrackingState(state.displacement, state.inputs)

    def section_frames(self, state: TrackingState) -> Frames:
        """Give the sections' frames in a state."""
        return self.model.section_fit.at(self.model.body.points + state.displacement).frames

    def linearise(self, state: TrackingState, inputs: Inputs) -> TrackingStep:
        """Linearise about a state under given inputs."""
        balance = self.model.balance(state.displacement, inputs, tangent=False)
        fitted = self.model.section_fit.at(self.model.body.points + state.displacement)
        stiffness = self._stiffness(state, inputs, balance) if balance.evaluation.valid else None
        return TrackingStep(self.model, state, inputs, balance, fitted, stiffness)

    def _stiffness(self, state: TrackingState, inputs: Inputs, balance: Balance) -> Stiffness | None:
        held, arrived = state.stiffness, not np.isfinite(state.forces)
        moved_on = not np.array_equal(inputs.gravity, state.inputs.gravity)
        left = float(np.linalg.norm(balance.residual))
        calm = arrived or moved_on or balance.norm < self.model.settings.tolerance
        slow = not calm and left >= self.contraction * state.forces
        nearest = held
        if self.background is not None:
            if held is None or moved_on or (not calm and left >= self.slowing * state.forces):
                self.background.offer(state.displacement, inputs)
            # Another factor has other sensitivities and so another optimum: none is swapped near the end.
            if held is None or arrived or slow:
                nearest = _nearer(state.displacement, held, self.background.latest)
        if nearest is not None and (not slow or nearest is not held):
            return nearest
        return take_stiffness(self.model, state.displacement, inputs)

    def advance(self, step: TrackingStep, change: Floats) -> TrackingState:
        """Take the Newton step for inputs changed by ``change`` (pressures, then loads)."""
        pressures = step.inputs.pressures + change[: self.chambers]
        inputs = Inputs(pressures, step.inputs.loads + change[self.chambers :], step.inputs.gravity)
        if step.stiffness is None:
            return replace(step.state, inputs=inputs)
        displacement = step.moved(change)
        # A step for new inputs turns the body; what it leaves out of balance says nothing of the factor.
        forces = step.forces(change) if step.turn(change) <= CORRECTING_RAD else np.inf
        return TrackingState(displacement, inputs, step.stiffness, forces)

    def solve(self, inputs: Inputs, start: TrackingState) -> tuple[TrackingState, bool]:
        """Find the equilibrium under fixed inputs; the flag tells whether it converged."""
        found, converged = self.model.solve(inputs, FiniteElementState(start.displacement, start.inputs))
        return TrackingState(found.displacement, found.inputs, start.stiffness), converged


def _nearer(displacement: Floats, held: Stiffness | None, other: Stiffness | None) -> Stiffness | None:
    """Choose the factor that was taken nearer to a configuration."""
    if held is None or other is None:
        return held or other
    away = [np.linalg.norm(displacement - one.displacement) for one in (held, other)]
    return other if away[1] < away[0] else held


def predict_state(past: tuple[tuple[float, TrackingState], ...], time: float) -> TrackingState:
    """Extrapolate the states of past instants, by a polynomial of one degree less than their number.

    Worth it where the motion is smooth and its estimates are hardly noisy: a quadratic through three equally
    spaced instants multiplies white noise by the square root of 19.

    Args:
        past: Up to three times [s] and states, the last one latest.
        time: Instant to predict [s].

    Returns:
        The state, with the inputs and the factor of the last one.
    """
    times = np.array([instant for instant, _ in past])
    last = past[-1][1]
    displacement = np.zeros_like(last.displacement)
    for k, (instant, state) in enumerate(past):
        others = np.delete(times, k)
        displacement += float(np.prod((time - others) / (instant - others))) * state.displacement
    return replace(last, displacement=displacement)

"""A model of many samples whose effective pressures grow with the stretch of their chambers."""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.rotations import exp
from softarm.estimator.sequential_batch import LARGEST_MOVE
from softarm.estimator.stretch.law import StretchLaw
from softarm.estimator.wrapper import BatchModelWrapper

PASSES = 6


@dataclass(frozen=True)
class StretchedBatch(BatchModelWrapper):
    """A model whose pressures follow the stretch of their chambers; implements ``BatchArmModel``.

    Args:
        model: The model, without stretch.
        law: The stretch of each chamber, and its effective pressure under it.
    """

    law: StretchLaw

    def evaluate(
        self,
        inputs: BatchInputs,
        *,
        start: ArmResponse | None = None,
        jacobians: bool = True,  # noqa: ARG002
    ) -> ArmResponse:
        """Solve many samples at pressures on unstretched chambers; see ``BatchArmModel.evaluate``.

        The pressures are made with the stretches of ``start``; what these have changed by since is made up
        for by one Newton step, as long as that is short. The derivatives are needed for it, wanted or not.
        """
        law, pressures = self.law, inputs.pressures
        stretches = np.zeros_like(pressures)
        if start is not None:
            stretches = np.where(start.converged[:, None], law.stretches(start.frames), 0.0)
        for _ in range(PASSES):
            effective = law.effective(pressures, stretches)
            inner = self.model.evaluate(replace(inputs, pressures=effective), start=start)
            move, following = self._following(pressures, stretches, inner)
            if np.abs(move[inner.converged]).max(initial=0.0) < LARGEST_MOVE:
                break
            start = inner
            stretches = np.where(inner.converged[:, None], law.stretches(inner.frames), 0.0)
        return self._followed(inner, move, following)

    def _following(self, pressures: Floats, stretches: Floats, inner: ArmResponse) -> tuple[Floats, Floats]:
        """Let the pressures follow the stretch.

        With C the twists per unit of pressure, E the rows of the stretches and G = g p, all motion m becomes
        A m, A = 1 + C G (1 - E C G)^-1 E, and the stretches' change q since they were taken moves by A C G q.
        """
        reached, rows = self.law.linearise(inner.frames)
        pushed = inner.pressure_jacobian * (self.law.gain * pressures)[:, None, :]
        remaining = np.eye(pressures.shape[1]) - rows @ pushed
        following = np.eye(rows.shape[-1]) + pushed @ np.linalg.solve(remaining, rows)
        change = (reached - stretches)[..., None]
        move: Floats = (following @ (pushed @ change))[..., 0]
        return move, following

    def _followed(self, inner: ArmResponse, move: Floats, following: Floats) -> ArmResponse:
        twists = move.reshape(len(move), move.shape[1] // 6, 6)  # numpy cannot infer -1 without samples
        positions = inner.frames.positions + twists[..., :3]
        frames = Frames(positions, exp(twists[..., 3:]) @ inner.frames.rotations)
        input_jacobian = following @ inner.input_jacobian
        # By pressures on unstretched chambers, in place of the effective ones.
        input_jacobian[..., : self.chambers] *= (1.0 + self.law.gain * self.law.stretches(frames))[:, None, :]
        wanted = {
            name: following @ jacobian
            for name in ("factor_jacobian", "eigenstrain_jacobian")
            if len(jacobian := getattr(inner, name))
        }
        return replace(inner, frames=frames, input_jacobian=input_jacobian, **wanted)

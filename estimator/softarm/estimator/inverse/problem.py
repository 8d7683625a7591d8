"""An inverse problem: objectives and limits."""

from dataclasses import dataclass
from typing import TypeVar

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.estimate import ArmEstimate, make_estimate
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.minimise import Linearised, Tolerances, minimise
from softarm.estimator.inverse.objectives import Objective
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation
from softarm.estimator.sensing import SensorSuite

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


@dataclass(frozen=True)
class Problem:
    """Objectives and limits of one instant.

    Args:
        unknowns: Names and scales of the inputs.
        suite: The sensors.
        objectives: What the inputs should meet.
        limits: Bounds and held inputs.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
    """

    unknowns: Unknowns
    suite: SensorSuite
    objectives: tuple[Objective, ...]
    limits: InputBounds
    gravity: Floats

    def solve(
        self,
        model: ArmModel[State, Step],
        start: tuple[State, Inputs],
        tolerances: Tolerances | None = None,
        begun: Linearised[State] | None = None,
    ) -> ArmEstimate[State]:
        """Search from a state and inputs, or from where an earlier search left off if that serves."""
        state, inputs = start
        inputs = Inputs(inputs.pressures, inputs.loads, self.gravity)
        start = (state, inputs)
        minimum = minimise(model, self.unknowns, self.objectives, self.limits, start, tolerances, begun)
        return make_estimate(minimum, self.unknowns, self.limits, self.gravity, self.suite)

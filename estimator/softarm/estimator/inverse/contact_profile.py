"""Where along the arm a force acts, from one linearisation: quick enough to accompany every estimate."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.estimate import ArmEstimate
from softarm.estimator.model import ArmModel, Inputs, Linearisation, Load, loads_along
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.sensing.model_error import UNPULLED_ERROR

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

LEAST_ROWS = 6
"""Fewer independent measurements cannot separate a force, its place and an error of the model."""
FINE = 20
"""Heights tried between two candidates."""
CHI_SQUARE_95 = 3.841
"""95th percentile of chi-square with one degree of freedom."""
INTERVAL_95 = 3.92
"""Width of a 95 % interval in standard deviations."""


@dataclass(frozen=True)
class ContactPlace:
    """One push and its place.

    Args:
        height: Most likely rest distance from the base [m].
        deviation: Standard deviation of the height [m], from the width of the 95 % interval.
        force: The push in the base frame [N], shape (2,): x and y.
        located: Whether the 95 % interval is shorter than half of the candidates' range.
    """

    height: float
    deviation: float
    force: Floats
    located: bool


@dataclass(frozen=True)
class ContactProfile:
    """Places one push among candidate heights.

    About a state with the loads L and pushes P, r = innovation + J_L (L - L_tare) + J_P P is what one push
    must explain: r = J_h f + noise, where J_h are the sensors' derivatives by a lateral force f at height h
    and the noise is that of the sensors, of the model and, through J_p, of the pressures. The least weighted
    sum of squares at each height is the profile of the likelihood. The first pass is about the estimate's own
    state, each further one about the equilibrium under the push of the last one.

    Args:
        heights: Candidate rest distances from the base [m], rising, shape (candidates,).
        force_sigma: Standard deviation assumed for each component of the push [N].
        passes: Number of linearisations.
        form_share: Error of the model's response to a push where no calibration has pulled, as a share of
            that response in each reading: shear that was fitted as bending looks like another height.
    """

    heights: Floats
    force_sigma: float = 2.0
    passes: int = 2
    form_share: float = UNPULLED_ERROR

    @property
    def loads(self) -> tuple[Load, ...]:
        """The pushes along x and y at every candidate height."""
        return tuple(
            load
            for index, height in enumerate(self.heights.tolist())
            for load in loads_along(f"push_{index}", "xy", height=height)
        )

    def place(
        self,
        model: ArmModel[State, Step],
        start: State,
        suite: SensorSuite,
        readings: Floats,
        estimate: ArmEstimate[State],
        tare: Floats,
    ) -> ContactPlace | None:
        """Place the push that explains what the estimate's loads, less the tare, explain.

        Args:
            model: The model with the estimate's loads followed by ``loads``.
            start: The estimate's state, in this model's form.
            suite: The sensors.
            readings: Stacked readings of the instant, NaN where absent, shape (readings,).
            estimate: The estimate at that instant.
            tare: Load amplitudes that count as zero, shape (loads,).

        Returns:
            The place, or ``None`` with fewer than six independent measurements.
        """
        if len(next(row for row in estimate.rows if row.name == "sensors").innovation) < LEAST_ROWS:
            return None
        acting = np.concatenate([estimate.inputs.loads, np.zeros(2 * len(self.heights))])
        unknown = np.concatenate([tare, np.zeros(2 * len(self.heights))])
        inputs, state = Inputs(estimate.inputs.pressures, acting, estimate.inputs.gravity), start
        for _ in range(self.passes - 1):
            contact = self._pass(model, state, inputs, suite, readings, estimate, unknown)
            amplitudes = unknown.copy()
            amplitudes[len(tare) :] = self._share(contact).ravel()
            inputs = Inputs(inputs.pressures, amplitudes, inputs.gravity)
            state, converged = model.solve(inputs, state)
            if not converged:
                return contact
        return self._pass(model, state, inputs, suite, readings, estimate, unknown)

    def _pass(
        self,
        model: ArmModel[State, Step],
        state: State,
        inputs: Inputs,
        suite: SensorSuite,
        readings: Floats,
        estimate: ArmEstimate[State],
        unknown: Floats,
    ) -> ContactPlace:
        """Place the push by one linearisation about a state under given inputs."""
        step = model.linearise(state, inputs)
        chambers = model.chambers
        observation = suite.observe(step.frames, readings)
        drift, response = step.response(observation.twists)
        to_pressures, to_loads = response[:, :chambers], response[:, chambers:]
        explained = observation.innovation - drift + to_loads @ (inputs.loads - unknown)
        spread = estimate.covariance[:chambers, :chambers]
        covariance = observation.covariance + to_pressures @ spread @ to_pressures.T
        covariance = covariance + np.diag((self.form_share * explained) ** 2)
        to_pushes = to_loads[:, -2 * len(self.heights) :]
        information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        return self._best(explained, to_pushes, information)

    def _share(self, contact: ContactPlace) -> Floats:
        """Return the push to the two candidates beside it: same force, same moment; shape (candidates, 2)."""
        return np.outer(self._weights(contact.height), contact.force)

    def _weights(self, heights: Floats | float) -> Floats:
        """Return the share of each candidate in a push between two, shape (candidates, heights...)."""
        return np.array([np.interp(heights, self.heights, unit) for unit in np.eye(len(self.heights))])

    def _best(self, explained: Floats, to_pushes: Floats, information: Floats) -> ContactPlace:
        """Find the height and force of the least weighted sum of squares."""
        count = len(self.heights)
        fine = np.linspace(self.heights[0], self.heights[-1], FINE * count)
        columns = np.einsum("rck,ch->rhk", to_pushes.reshape(-1, count, 2), self._weights(fine))
        weighted = np.einsum("rs,rhk->shk", information, columns)
        normal = np.einsum("shk,shj->hkj", weighted, columns) + np.eye(2) / self.force_sigma**2
        gradient = np.einsum("shk,s->hk", weighted, explained)
        forces = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        profile = float(explained @ information @ explained) - np.einsum("hk,hk->h", gradient, forces)
        best = int(np.argmin(profile))
        inside = fine[profile - profile[best] <= CHI_SQUARE_95]
        width = float(inside.max() - inside.min()) + float(fine[1] - fine[0])
        located = width < 0.5 * float(self.heights[-1] - self.heights[0])
        return ContactPlace(float(fine[best]), width / INTERVAL_95, forces[best], located)

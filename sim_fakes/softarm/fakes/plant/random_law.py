"""Smooth random functions of random states of an arm: physics that nobody had in mind.

A law is a draw of a Gaussian process of unit variance with a squared exponential kernel, by random
Fourier features (Rahimi and Recht, Adv. Neural Inf. Process. Syst. 20 (2007) 1177), less its value in the
state of rest: f(s) = sqrt(2 / K) sum_k (cos(w_k . s + b_k) - cos(b_k)). It pushes one segment in one
direction.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats

PRESSURE, BEND = 50e3, 0.6
"""Pressure [Pa] and bend [rad] that count as one."""
LENGTH = 0.7
"""Distance over which a law changes, in these units."""
FEATURES = 64
TIMES = (0.3, 30.0)
"""Shortest and longest memory of pressures past [s]."""
DEPENDS_ON = 3
"""Numbers of the state, among pressures, past pressures and bends, that a law depends on."""


@dataclass(frozen=True)
class RandomLaw:
    """A law and what it remembers.

    Args:
        strength: Standard deviation of the push, as a pressure in a chamber [Pa].
        chosen: Which numbers of the state it depends on, shape (DEPENDS_ON,).
        waves: Wave vectors, shape (FEATURES, DEPENDS_ON).
        phases: Shape (FEATURES,).
        direction: Of the push, over all chambers, shape (chambers,).
        time: Of its memory [s].
        past: Pressures as it remembers them [Pa]; changed in place.
    """

    strength: float
    chosen: NDArray[np.int64]
    waves: Floats
    phases: Floats
    direction: Floats
    time: float
    past: Floats

    @classmethod
    def draw(cls, strength: float, seed: int, groups: tuple[tuple[int, ...], ...]) -> "RandomLaw":
        """Draw a law.

        Args:
            strength: Of the push [Pa].
            seed: Which law.
            groups: Chambers of each segment.
        """
        rng = np.random.default_rng([seed, 2007])
        segments, chambers = len(groups), sum(map(len, groups))
        chosen = rng.choice(2 * chambers + 2 * segments, DEPENDS_ON, replace=False)
        direction = np.zeros(chambers)
        pushed = rng.normal(size=max(map(len, groups)))
        group = groups[int(rng.integers(segments))]
        direction[list(group)] = pushed[: len(group)] / np.linalg.norm(pushed[: len(group)])
        waves = rng.normal(size=(FEATURES, DEPENDS_ON)) / LENGTH
        phases = rng.uniform(0.0, 2.0 * np.pi, FEATURES)
        time = float(np.exp(rng.uniform(*np.log(TIMES))))
        return cls(strength, chosen, waves, phases, direction, time, np.zeros(chambers))

    def push(self, pressures: Floats, bends: Floats, step: float) -> Floats:
        """Return the pressures that would push as much, and remember those of this step.

        Args:
            pressures: In the chambers [Pa], shape (chambers,).
            bends: Of the segments about x and y [rad], shape (segments, 2).
            step: Time since the last call [s].
        """
        self.past[:] += -np.expm1(-step / self.time) * (pressures - self.past)
        state = np.concatenate([pressures / PRESSURE, self.past / PRESSURE, bends.ravel() / BEND])
        angles = self.waves @ state[self.chosen] + self.phases
        size = np.sqrt(2.0 / FEATURES) * float(np.sum(np.cos(angles) - np.cos(self.phases)))
        pushed: Floats = self.strength * size * self.direction
        return pushed

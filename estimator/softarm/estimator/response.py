"""What an arm does at many samples, how that changes, and the models that solve many samples at once."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.model import ArmDescription, Frames, Inputs


def _no_columns() -> Floats:
    return np.zeros((0, 0, 0))


@dataclass(frozen=True)
class ArmResponse:
    """What an arm does at many samples, with the derivatives of its section twists.

    A twist is a translation [m], then a rotation vector [rad], in the base frame; those of all sections are
    stacked. A derivative that a model does not provide, or that was not requested, has no columns.

    Args:
        frames: Frames of the sections, arrays with a leading axis (samples,).
        converged: Where the solve converged to an equilibrium, shape (samples,).
        chambers: Number of chambers.
        input_jacobian: Section twists per unit of each pressure, each load and each component of gravity,
            shape (samples, 6 sections, chambers + loads + 3).
        factor_jacobian: Section twists per unit of the logarithm of each region's stiffness factor, shape
            (samples, 6 sections, regions).
        eigenstrain_jacobian: Section twists per unit of each region's eigenstrains, shape (samples,
            6 sections, 4 regions).
        strains: Generalised strains of the segments where they are known: rotation vector of the lower end
            relative to the upper one [rad], then elongation [m]; shape (samples, segments, 4).
        states: The model's state at each sample, to begin other solves with, shape (samples, ...).
    """

    frames: Frames
    converged: Flags
    chambers: int = 0
    input_jacobian: Floats = field(default_factory=_no_columns)
    factor_jacobian: Floats = field(default_factory=_no_columns)
    eigenstrain_jacobian: Floats = field(default_factory=_no_columns)
    strains: Floats = field(default_factory=_no_columns)
    states: NDArray[Any] = field(default_factory=lambda: np.zeros(0))

    @property
    def pressure_jacobian(self) -> Floats:
        """Section twists per unit of each pressure, shape (samples, 6 sections, chambers)."""
        return self.input_jacobian[..., : self.chambers]

    @property
    def load_jacobian(self) -> Floats:
        """Section twists per unit of each load, shape (samples, 6 sections, loads)."""
        return self.input_jacobian[..., self.chambers : -3]

    @property
    def gravity_jacobian(self) -> Floats:
        """Section twists per component of gravity, shape (samples, 6 sections, 3)."""
        return self.input_jacobian[..., -3:]

    def at(self, chosen: Flags | Indices) -> "ArmResponse":
        """Select samples by flags or numbers."""
        # A derivative that was not requested has no samples to choose from.
        kept: dict[str, Any] = {n: array[chosen] for n, array in self._arrays.items() if len(array)}
        frames = Frames(self.frames.positions[chosen], self.frames.rotations[chosen])
        return replace(self, frames=frames, converged=self.converged[chosen], **kept)

    def with_samples(self, chosen: Indices, answer: "ArmResponse") -> "ArmResponse":
        """Return the response with another one's at the samples of some numbers, shape (chosen,).

        Derivatives that either lacks stay as they are.
        """

        def put(array: NDArray[Any], new: NDArray[Any]) -> NDArray[Any]:
            array = array.copy()
            array[chosen] = new
            return array

        answered = answer._arrays
        both = {n: (a, answered[n]) for n, a in self._arrays.items() if a.size and answered[n].size}
        put_in: dict[str, Any] = {n: put(*pair) for n, pair in both.items()}
        frames = Frames(
            put(self.frames.positions, answer.frames.positions),
            put(self.frames.rotations, answer.frames.rotations),
        )
        return replace(self, frames=frames, converged=put(self.converged, answer.converged), **put_in)

    def with_states(self, states: NDArray[Any]) -> "ArmResponse":
        """Return the response with other states to begin at, shape (samples, ...)."""
        return replace(self, states=states)

    @property
    def _arrays(self) -> dict[str, NDArray[Any]]:
        names = ("input_jacobian", "factor_jacobian", "eigenstrain_jacobian", "strains", "states")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class BatchInputs:
    """Inputs of many samples.

    Args:
        pressures: Gauge pressures in the chambers [Pa], shape (samples, chambers).
        loads: Amplitudes of the model's loads [N or N m], shape (samples, loads).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,) or (samples, 3).
        eigenstrains: What the material of each region strains beside what its law gives: two bends, the
            twist [rad] and the elongation [m], shape (samples, regions, 4).
    """

    pressures: Floats
    loads: Floats
    gravity: Floats
    eigenstrains: Floats | None = None

    @classmethod
    def none(cls, model: ArmDescription) -> Self:
        """Return one sample of a model that nothing acts on."""
        return cls(np.zeros((1, model.chambers)), np.zeros((1, len(model.loads))), np.zeros(3))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.pressures)

    def samples(self) -> Iterator[Inputs]:
        """Return the inputs of each sample."""
        return map(Inputs, self.pressures, self.loads, np.broadcast_to(self.gravity, (len(self), 3)))


class BatchArmModel(ArmDescription, Protocol):
    """A model of the arm that solves many samples in one call, such as the calibrated rod."""

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions whose stiffness can be scaled."""

    @property
    def takes_eigenstrains(self) -> bool:
        """Whether its regions can strain freely."""

    def with_scales(self, scales: Mapping[str, float]) -> Self:
        """Return a copy with other stiffness factors of some regions."""

    def evaluate(
        self, inputs: BatchInputs, *, start: ArmResponse | None = None, jacobians: bool = True
    ) -> ArmResponse:
        """Solve many samples.

        Args:
            inputs: Of each sample.
            start: An earlier response to the same samples, whose states the solves begin from.
            jacobians: Whether the derivatives are wanted.
        """

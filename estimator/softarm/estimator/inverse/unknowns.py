"""The unknowns of the inverse problem: chamber pressures, then load amplitudes, in one vector."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Inputs, Load


@dataclass(frozen=True)
class Unknowns:
    """Names and sizes of the entries of the input vector u = (pressures, loads).

    Args:
        chambers: Number of pressures.
        loads: The model's loads.
        scale: A typical change of each entry [Pa, N or N m], shape (inputs,); makes the problem's numbers
            of order one and sets the proportion in which entries of different units are compared.
    """

    chambers: int
    loads: tuple[Load, ...]
    scale: Floats

    @classmethod
    def of(
        cls,
        chambers: int,
        loads: Sequence[Load],
        pressure: float = 2e4,
        force: float = 0.5,
        moment: float = 0.05,
    ) -> "Unknowns":
        """Scale pressures [Pa], forces [N] and moments [N m] by one typical value each."""
        sizes = [force if load.kind == "force" else moment for load in loads]
        return cls(chambers, tuple(loads), np.array([pressure] * chambers + sizes))

    @property
    def size(self) -> int:
        """Number of inputs."""
        return self.chambers + len(self.loads)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each input: ``pressure_<k>``, then the names of the loads."""
        return (*(f"pressure_{k}" for k in range(self.chambers)), *(load.name for load in self.loads))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each input."""
        return (
            *("Pa" for _ in range(self.chambers)),
            *("N" if load.kind == "force" else "N m" for load in self.loads),
        )

    def vector(self, inputs: Inputs) -> Floats:
        """Stack pressures [Pa] and loads [N or N m], shape (inputs,)."""
        return np.concatenate([inputs.pressures, inputs.loads])

    def inputs(self, vector: Floats, gravity: Floats) -> Inputs:
        """Split a vector, shape (inputs,), into pressures and loads; gravity [m/s2] has shape (3,)."""
        return Inputs(vector[: self.chambers], vector[self.chambers :], gravity)

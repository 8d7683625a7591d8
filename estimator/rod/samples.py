"""Equilibria of the finite-element model, with their derivatives: what the link laws are fitted to."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from estimator.fem import FiniteElementModel, Settings
from estimator.fem.equilibrium import exact_factor
from estimator.fem.factor import StiffnessFactor
from estimator.model import Inputs, Load
from estimator.rod.stations import NEAR, Stations
from estimator.specimen import Specimen

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[int, int], None]

STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class Samples:
    """States of the finite-element model.

    Args:
        pressures: [Pa], shape (samples, chambers).
        loads: Amplitudes of ``sampling_loads`` [N or N m], shape (samples, loads).
        gravity: [m/s2], shape (samples, 3).
        positions: Origins of the stations' frames [m], shape (samples, stations, 3).
        rotations: Shape (samples, stations, 3, 3).
        twists: Their twists per unit of each pressure, then each load, shape (samples, stations, 6, inputs).
        ray: Ray that each sample lies on, shape (samples,).
    """

    pressures: Floats
    loads: Floats
    gravity: Floats
    positions: Floats
    rotations: Floats
    twists: Floats
    ray: Indices

    def __len__(self) -> int:
        return len(self.pressures)

    def select(self, keep: NDArray[np.bool_]) -> "Samples":
        """Keep some samples, shape (samples,)."""
        return Samples(**{field.name: getattr(self, field.name)[keep] for field in fields(self)})


@dataclass(frozen=True)
class Plan:
    """Where to sample.

    Rays lead from rest to the corners of a box; every step on the way is a sample, so what is solved to get
    there is not lost.

    Args:
        rays: Number of rays.
        seed: Of the Sobol sequence.
        pressure: Largest pressure over the specimen's limit.
        rotation: Rotation [rad] that each load alone would cause at most, were the arm linear.
        step: Step along a ray; halved where the model does not follow.
    """

    rays: int = 32
    seed: int = 7
    pressure: float = 1.1
    rotation: float = 0.25
    step: float = 0.1


def sampling_loads(specimen: Specimen) -> tuple[Load, ...]:
    """Give a force and a moment along each axis on every rigid section beyond a soft segment."""
    soft = min(segment.to_m for segment in specimen.segments)
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    kinds: tuple[tuple[str, str], ...] = (("force", "f"), ("moment", "m"))
    return tuple(
        Load(
            f"{section.name}_{short}{name}",
            "force" if kind == "force" else "moment",
            axis,
            section=section.name,
        )
        for section in specimen.sections
        if section.to_m >= soft - NEAR
        for kind, short in kinds
        for name, axis in axes.items()
    )


def draw_samples(
    specimen: Specimen,
    model: FiniteElementModel,
    stations: Stations,
    plan: Plan,
    progress: Progress | None = None,
) -> Samples:
    """Solve the finite-element model along rays of pressures, loads and gravity.

    Args:
        specimen: Description, for the pressures' limits.
        model: Its finite-element model with ``sampling_loads``.
        stations: Where its frames are wanted.
        plan: Where to sample.
        progress: Called with the rays done and all of them.

    Returns:
        The states that were found; a ray ends where the arm loses its stability.
    """
    scale = load_scale(model, stations, plan.rotation)
    found: list[tuple[Floats, ...]] = []
    for index, end in enumerate(_ends(specimen, model, scale, plan)):
        found += [(*state, np.array(index)) for state in _follow(model, stations, end, plan)]
        if progress is not None:
            progress(index + 1, plan.rays)
    return Samples(*(np.array(column) for column in zip(*found, strict=True)))


def load_scale(model: FiniteElementModel, stations: Stations, rotation: float) -> Floats:
    """Give the size of each load that would turn some station by a rotation [rad], were the arm linear.

    An axial force gets the size of the lateral ones of its section.
    """
    displacement = np.zeros_like(model.body.points)
    inputs = model.no_inputs()
    factor = _factor(model, displacement, inputs)
    assert factor is not None
    twists = _twists(model, stations, displacement, inputs, factor)[2]
    turning = np.linalg.norm(twists[:, 3:, model.chambers :], axis=1).max(axis=0)
    for k, load in enumerate(model.loads):
        if load.kind == "force" and load.direction[2] == 1.0:
            turning[k] = turning[k - 1]
    scale: Floats = rotation / turning
    return scale


def _ends(specimen: Specimen, model: FiniteElementModel, scale: Floats, plan: Plan) -> Iterator[Inputs]:
    """Give the ends of the rays; every other one hangs, the rest have gravity in any direction."""
    chambers, loads = model.chambers, len(model.loads)
    sequence = qmc.Sobol(chambers + loads + 2, rng=plan.seed).random_base2(int(np.ceil(np.log2(plan.rays))))
    limits = np.array(specimen.pressure_limits)
    for index, row in enumerate(sequence[: plan.rays]):
        # Every third ray goes to full pressure under small loads: that is how the arm is mostly used.
        size = scale if index % 3 else 0.3 * scale
        rise, turn = 2.0 * row[-2] - 1.0, 2.0 * np.pi * row[-1]
        flat = np.sqrt(1.0 - rise**2)
        gravity = (
            np.array([flat * np.cos(turn), flat * np.sin(turn), rise]) if index % 2 else np.array([0, 0, 1.0])
        )
        yield Inputs(
            plan.pressure * limits * row[:chambers],
            size * (2.0 * row[chambers : chambers + loads] - 1.0),
            STANDARD_GRAVITY * gravity,
        )


def _follow(
    model: FiniteElementModel, stations: Stations, end: Inputs, plan: Plan
) -> Iterator[tuple[Floats, ...]]:
    """Walk along a ray until its end or until the arm loses its stability."""
    model = replace(model, settings=Settings(total_iterations=40))
    share, step, state = 0.0, plan.step, model.rest()
    while share < 1.0 - 1e-9 and step > 0.3 * plan.step:
        target = min(share + step, 1.0)
        inputs = Inputs(target * end.pressures, target * end.loads, target * end.gravity)
        found = model.equilibrium(inputs, state)
        factor = _factor(model, found.value.displacement, inputs) if found.converged else None
        if factor is None:
            step *= 0.5
            continue
        share, state = target, found.value
        positions, rotations, twists = _twists(model, stations, state.displacement, inputs, factor)
        yield inputs.pressures, inputs.loads, inputs.gravity, positions, rotations, twists


def _factor(model: FiniteElementModel, displacement: Floats, inputs: Inputs) -> StiffnessFactor | None:
    return exact_factor(model.body, model.balance(displacement, inputs))


def _twists(
    model: FiniteElementModel,
    stations: Stations,
    displacement: Floats,
    inputs: Inputs,
    factor: StiffnessFactor,
) -> tuple[Floats, Floats, Floats]:
    """Give the stations' frames and their twists per unit of each input at an equilibrium."""
    balance = model.balance(displacement, inputs, tangent=False)
    nodal = np.concatenate([balance.evaluation.gradients, balance.load_vectors])
    moves = factor.solve(model.body.pattern.gather(nodal))
    return stations.poses(model.body.points + displacement, model.body.pattern.scatter(moves))

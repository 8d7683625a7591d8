"""Equilibria of the finite-element model, with their derivatives: what the link laws are fitted to."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel, Settings
from softarm.estimator.fem.linalg.cholesky import StiffnessFactor
from softarm.estimator.fem.statics.continuation import Waypoint, between, extrapolate, path_velocity
from softarm.estimator.fem.statics.equilibrium import Balance, correct
from softarm.estimator.model import Inputs, Load, loads_along
from softarm.estimator.rod.load_stiffness import exact_moves
from softarm.estimator.rod.stations import NEAR, Stations
from softarm.estimator.rotations import log
from softarm.estimator.specimen import Specimen

Progress = Callable[[int, int], None]

STANDARD_GRAVITY = 9.80665
TOLERANCE = 1e-8
"""Out-of-balance force over the applied force at which a sample counts as an equilibrium."""
# An equilibrium that needs more lies too far ahead on the ray.
NEWTON_STEPS = 9
FIRST = 0.25
"""First step along a ray, over the largest: at rest the arm is at its softest."""
FAILURES = 5
"""Steps that may fail before a ray is left."""


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
        factors: Stiffness factor of each link, shape (samples, links).
        softness: Rotation per load over that at rest, shape (samples,).
    """

    pressures: Floats
    loads: Floats
    gravity: Floats
    positions: Floats
    rotations: Floats
    twists: Floats
    factors: Floats
    softness: Floats

    def __len__(self) -> int:
        return len(self.pressures)


@dataclass(frozen=True)
class SamplingPlan:
    """Where to sample.

    Rays lead from rest to the corners of a box; every step on the way is a sample, so what is solved to get
    there is not lost.

    Args:
        rays: Number of rays.
        seed: Of the Sobol sequence.
        pressure: Largest pressure over the specimen's limit.
        rotation: Rotation [rad] that each load alone would cause at most, were the arm linear.
        step: Largest step along a ray; halved where the model does not follow.
        stretch: Largest stiffness factor of a soft segment, and one over the smallest; 1 for none.
        soft: Rotation per load, over that at rest, at which a ray ends: beyond it the arm is about to buckle.
        bend: Sum of the rotations from station to station [rad] at which a ray ends.
        kinds: Loads of the rays in turn: whether the lateral forces on one place act alone, and how large
            they are over their scale.
    """

    rays: int = 32
    seed: int = 7
    pressure: float = 1.1
    rotation: float = 0.25
    step: float = 0.125
    stretch: float = 1.0
    soft: float = 1.5
    bend: float = np.inf
    kinds: tuple[tuple[bool, float], ...] = ((False, 0.3), (True, 4.0), (False, 0.7), (True, 2.0))


def sampling_loads(specimen: Specimen) -> tuple[Load, ...]:
    """List a force and a moment along each axis on every rigid section beyond a soft segment."""
    soft = min(segment.to_m for segment in specimen.segments)
    kinds: tuple[Literal["force", "moment"], ...] = ("force", "moment")
    return tuple(
        load
        for section in specimen.sections
        if section.to_m >= soft - NEAR
        for kind in kinds
        for load in loads_along(f"{section.name}_{kind}", "xyz", kind, section=section.name)
    )


def draw_samples(
    specimen: Specimen,
    model: FiniteElementModel,
    stations: Stations,
    plan: SamplingPlan,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Samples:
    """Solve the finite-element model along rays of pressures, loads and gravity.

    A ray ends where the arm is about to lose its stability. The threads of ``executor`` walk the rays side by
    side; the kernels run without the interpreter's lock.
    """
    scale = load_scale(specimen, model, stations, plan.rotation)
    rays = list(_rays(specimen, model, scale, plan))

    present = dict(zip(model.parameters, model.scales.tolist(), strict=True))

    def walk(ray: Ray) -> list[tuple[Floats, ...]]:
        scales = present | {name: factor * present[name] for name, factor in ray.factors.items()}
        return list(_follow(model.with_scales(scales), stations, ray, plan, scales))

    samples: list[tuple[Floats, ...]] = []
    for index, states in enumerate(map(walk, rays) if executor is None else executor.map(walk, rays)):
        samples += states
        if progress is not None:
            progress(index + 1, len(rays))
    return Samples(*(np.array(column) for column in zip(*samples, strict=True)))


def rest_twists(model: FiniteElementModel, stations: Stations) -> Floats:
    """Compute the stations' twists per unit of each input about the rest, shape (stations, 6, inputs)."""
    step = model.linearise(model.rest(), model.no_inputs())
    return stations.poses(model.body.points, step.input_fields())[2]


def load_scale(specimen: Specimen, model: FiniteElementModel, stations: Stations, rotation: float) -> Floats:
    """Compute the size of each load that would rotate some station by an angle [rad], were the arm linear.

    An axial force gets the size of the lateral ones of its section. Near the clamp only a large force rotates
    the arm at all: no force is larger than the largest of those on the sections.
    """
    scale = _rotating_loads(rest_twists(model, stations), model, rotation)
    forces = [load.kind == "force" for load in model.loads]
    on_sections = model.with_loads(sampling_loads(specimen))
    whole = _rotating_loads(rest_twists(on_sections, stations), on_sections, rotation)
    top = max(s for s, load in zip(whole, on_sections.loads, strict=True) if load.kind == "force")
    return np.where(forces, np.minimum(scale, top), scale)


def _rotating_loads(twists: Floats, model: FiniteElementModel, rotation: float) -> Floats:
    """Compute the size of each load that rotates some station by an angle, from twists per unit of it."""
    rotation_per_load = np.linalg.norm(twists[:, 3:, model.chambers :], axis=1).max(axis=0)
    for k, load in enumerate(model.loads):
        if load.kind == "force" and load.direction[2] == 1.0:
            # An axial force hardly rotates anything; the load before it is the lateral one along y.
            rotation_per_load[k] = rotation_per_load[k - 1]
    size: Floats = rotation / rotation_per_load
    return size


@dataclass(frozen=True)
class Ray:
    """Where a ray leads.

    Args:
        end: Inputs at its end.
        factors: Stiffness factors of the soft segments.
    """

    end: Inputs
    factors: dict[str, float]


def _rays(specimen: Specimen, model: FiniteElementModel, scale: Floats, plan: SamplingPlan) -> Iterator[Ray]:
    """Generate the rays; on half of them the arm hangs, on the rest gravity has any direction."""
    chambers, loads, segments = model.chambers, len(model.loads), len(specimen.segments)
    from scipy.stats import qmc  # a second to import, for every program that only reads a rod

    sequence = qmc.Sobol(chambers + loads + segments + 2, rng=plan.seed)
    # Sobol points are balanced in powers of two only.
    rows = sequence.random_base2(int(np.ceil(np.log2(plan.rays))))[: plan.rays]
    limits, kinds = np.array(specimen.pressure_limits), len(plan.kinds)
    owner = [[part.name for part in specimen.segments].index(c.segment) for c in specimen.chambers]
    for index, row in enumerate(rows):
        pushes, pulls, stretches, (rise, azimuth) = np.split(row, np.cumsum([chambers, loads, segments]))
        factors = plan.stretch ** (2.0 * stretches - 1.0)
        rise, azimuth = 2.0 * rise - 1.0, 2.0 * np.pi * azimuth
        flat = np.sqrt(1.0 - rise**2)
        anyhow = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), rise])
        # Pressures and loads grow with the stiffness, so that soft and stiff arms bend alike. Gravity changes
        # after two cycles through the kinds of loads, so that each kind meets both.
        end = Inputs(
            plan.pressure * limits * factors[owner] * pushes,
            scale * np.exp(np.log(factors).mean()) * _share(model.loads, index, plan) * (2.0 * pulls - 1.0),
            STANDARD_GRAVITY * (anyhow if index // (2 * kinds) % 2 else np.array([0.0, 0.0, 1.0])),
        )
        named = zip(specimen.segments, factors.tolist(), strict=True)
        yield Ray(end, {part.name: factor for part, factor in named})


def _share(loads: Sequence[Load], index: int, plan: SamplingPlan) -> Floats:
    """Compute the size of each load on a ray over its scale."""
    cycle, kind = divmod(index, len(plan.kinds))
    alone, size = plan.kinds[kind]
    if not alone:
        return np.full(len(loads), size)
    places = list(dict.fromkeys((load.section, load.height) for load in loads))
    chosen = places[cycle % len(places)] if places else None
    lateral = [
        load.kind == "force" and load.direction[2] == 0.0 and (load.section, load.height) == chosen
        for load in loads
    ]
    return size * np.array(lateral, dtype=np.float64)


def _follow(
    model: FiniteElementModel, stations: Stations, ray: Ray, plan: SamplingPlan, scales: Mapping[str, float]
) -> Iterator[tuple[Floats, ...]]:
    """Walk along a ray from rest until its end or until the arm grows soft."""
    settings = Settings(tolerance=TOLERANCE, iterations=NEWTON_STEPS)
    body, none, rest = model.body, model.no_inputs(), np.zeros_like(model.body.points)
    factors = np.array([scales.get(region, 1.0) for region in stations.chain.regions])
    before: Waypoint | None = None
    at_rest = model.linearise(model.rest(), none)
    assert at_rest.factor is not None
    frames = stations.poses(body.points, at_rest.input_fields())
    scale = _rotating_loads(frames[2], model, 1.0)
    yield none.pressures, none.loads, none.gravity, *frames, factors, np.array(1.0)
    here = Waypoint(0.0, rest, _velocity(model, at_rest.balance, at_rest.factor, ray))
    step, failures = FIRST * plan.step, 0
    while here.fraction < 1.0 - 1e-9 and failures < FAILURES:
        target = min(here.fraction + step, 1.0)
        inputs = between(none, ray.end, target)
        corrected = correct(body, model.balance, extrapolate(body, here, before, target), inputs, settings)
        if not corrected.solution.converged or corrected.factor is None:
            step, failures = 0.5 * step, failures + 1
            continue
        step = min(plan.step, (1.5 if corrected.solution.iterations <= 4 else 1.0) * step)
        place = corrected.solution.value
        velocity = _velocity(model, corrected.balance, corrected.factor, ray)
        before, here = here, Waypoint(target, place, velocity)
        moves = exact_moves(model, corrected.factor, place, inputs.loads, _input_forces(corrected.balance))
        if moves is None:
            return
        frames = stations.poses(body.points + place, moves)
        rotation = np.linalg.norm(frames[2][:, 3:, model.chambers :], axis=1) * scale
        softness = rotation.max(initial=0.0)
        if softness > plan.soft or _bend(frames[1]) > plan.bend:
            return
        yield inputs.pressures, inputs.loads, inputs.gravity, *frames, factors, np.array(softness)


def _bend(rotations: Floats) -> float:
    """Sum the angles from station to station [rad], the clamp first; rotations of shape (stations, 3, 3)."""
    before = np.concatenate([np.eye(3)[None], rotations[:-1]])
    return float(np.linalg.norm(log(np.swapaxes(before, -1, -2) @ rotations), axis=-1).sum())


def _velocity(model: FiniteElementModel, balance: Balance, factor: StiffnessFactor, ray: Ray) -> Floats:
    """Compute the displacement per share of a ray [m], shape (nodes, 3)."""
    return path_velocity(model.body, model.nodal_mass, balance, factor, model.no_inputs(), ray.end)


def _input_forces(balance: Balance) -> Floats:
    """Compute the nodal forces per unit of each pressure, then each load, shape (inputs, nodes, 3)."""
    return np.concatenate([balance.evaluation.gradients, balance.load_vectors])

"""How far a fitted rod is from its finite-element model where it was not fitted."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arm import default_loads
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.model import Frames, Inputs, Load, loads_along
from softarm.estimator.response import BatchInputs
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.rod.samples import Progress, Samples, SamplingPlan, draw_samples, load_scale
from softarm.estimator.rod.stations import NEAR, Stations
from softarm.estimator.rotations import log
from softarm.estimator.specimen import Specimen

UNTRAINED = (0.35, 0.6, 0.9)
"""Where between the ends of a soft segment loads act that are left out of the fit."""
SEARCH_STEPS = 12
CONTACTS = ((True, 3.0), (True, 1.0))
"""Rays of lateral forces between sections: one contact at a time."""


@dataclass(frozen=True)
class HeldOut:
    """Errors of the rod against the finite-element model, over all sections that move.

    Args:
        states: States compared.
        lost: States in which the rod found no equilibrium.
        angle_rms: Of the sections' orientations [rad].
        angle_max: Largest [rad].
        position_rms: Of the sections' origins [m].
        position_max: Largest [m].
        force_rms: Root mean square error of the lateral forces that the rod finds from the sections'
            orientations, pressures known, each over the largest of its kind.
        force_max: Largest of these errors.
        force_range: Largest lateral force of each kind [N].
    """

    states: int
    lost: int
    angle_rms: float
    angle_max: float
    position_rms: float
    position_max: float
    force_rms: float
    force_max: float
    force_range: tuple[float, ...]


@dataclass(frozen=True)
class HeldOutReport:
    """The errors of a rod in a check.

    Args:
        trained: Under forces and moments on the sections, as in the fit, at other inputs.
        untrained: Under lateral forces at heights at which no load acted in the fit.
    """

    trained: HeldOut
    untrained: HeldOut


def check_rod(
    rod: CalibratedRod,
    specimen: Specimen,
    model: FiniteElementModel,
    stations: Stations,
    plan: SamplingPlan,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> HeldOutReport:
    """Compare a rod with its finite-element model along rays that the fit did not use.

    ``plan`` has a seed of its own, so that no ray is one of the fit; see ``fit_rod`` for the others.
    """
    compared = []
    kinds = ((lateral_loads(specimen), plan), (untrained_loads(specimen), replace(plan, kinds=CONTACTS)))
    for number, (loads, rays) in enumerate(kinds):

        def advance(done: int, every: int, number: int = number) -> None:
            if progress is not None:
                progress(number * every + done, len(kinds) * every)

        loaded = model.with_loads(loads)
        samples = draw_samples(specimen, loaded, stations, rays, advance, executor)
        scale = load_scale(specimen, loaded, stations, plan.rotation)
        compared.append(compare(rod.with_loads(loads), samples, scale))
    return HeldOutReport(*compared)


def lateral_loads(specimen: Specimen) -> tuple[Load, ...]:
    """List two lateral forces on every section beyond a soft segment."""
    soft = min(segment.to_m for segment in specimen.segments)
    return default_loads(specimen, [s.name for s in specimen.sections if s.to_m >= soft - NEAR])


def untrained_loads(specimen: Specimen) -> tuple[Load, ...]:
    """List two lateral forces at each of ``UNTRAINED`` on every soft segment."""
    heights = (
        part.from_m + share * (part.to_m - part.from_m) for part in specimen.segments for share in UNTRAINED
    )
    return tuple(load for height in heights for load in loads_along(f"{height:.4f}", "xy", height=height))


def compare(rod: CalibratedRod, samples: Samples, scale: Floats) -> HeldOut:
    """Compare a rod with samples of its finite-element model.

    Args:
        rod: The rod, with the loads of the samples.
        samples: States of the model.
        scale: Typical size of each load [N or N m], shape (loads,).
    """
    truth = section_frames(rod, samples)
    response = rod.evaluate(BatchInputs(samples.pressures, samples.loads, samples.gravity))
    good = response.converged
    moving = rod.chain.section_station > 0
    gaps = (response.frames.positions - truth.positions)[good][:, moving]
    rotations = log(np.swapaxes(truth.rotations, -1, -2) @ response.frames.rotations)[good][:, moving]
    shift, angle = np.linalg.norm(gaps, axis=-1), np.linalg.norm(rotations, axis=-1)
    errors, largest = _force_errors(rod, samples, truth, scale)
    return HeldOut(
        len(samples),
        int((~good).sum()),
        _rms(angle),
        float(angle.max()),
        _rms(shift),
        float(shift.max()),
        _rms(errors),
        float(np.abs(errors).max(initial=0.0)),
        largest,
    )


def section_frames(rod: CalibratedRod, samples: Samples) -> Frames:
    """Compute the sections' frames of samples, which hold those of the stations after the clamp."""
    chain, count = rod.chain, len(samples)
    clamp = np.broadcast_to([0.0, 0.0, chain.heights[0]], (count, 1, 3))
    places = np.concatenate([clamp, samples.positions], axis=1)[:, chain.section_station]
    still = np.broadcast_to(np.eye(3), (count, 1, 3, 3))
    rotations = np.concatenate([still, samples.rotations], axis=1)[:, chain.section_station]
    return Frames(
        places + np.einsum("tsij,sj->tsi", rotations, chain.section_offset),
        rotations @ chain.section_rotation,
    )


def _force_errors(
    rod: CalibratedRod, samples: Samples, truth: Frames, scale: Floats
) -> tuple[Floats, tuple[float, ...]]:
    """Find each sample's forces from the orientations, one place at a time; errors over the largest force."""
    errors, largest = [], []
    for first in range(0, len(rod.loads), 2):
        pair = slice(first, first + 2)
        top = float(np.abs(samples.loads[:, pair]).max())
        largest.append(top)
        if top == 0.0:  # a pair that acts in no sample has no range to compare an error with
            continue
        for k in range(len(samples)):
            frames = Frames(truth.positions[k], truth.rotations[k])
            inputs = Inputs(samples.pressures[k], samples.loads[k].copy(), samples.gravity[k])
            value = find_forces(rod, inputs, frames, range(first, first + 2), scale)
            if value is not None:
                errors.append((value - samples.loads[k, pair]) / top)
    return np.array(errors), tuple(largest)


def find_forces(
    rod: CalibratedRod, inputs: Inputs, frames: Frames, unknown: Sequence[int], scale: Floats
) -> Floats | None:
    """Estimate some loads from the sections' orientations by Gauss-Newton, all else known.

    Args:
        rod: The rod.
        inputs: Inputs; the unknown loads among them are not looked at.
        frames: The sections' frames.
        unknown: Numbers of the unknown loads.
        scale: Typical size of each load, shape (loads,).

    Returns:
        The loads, shape (unknown,); None where the search did not end.
    """
    columns = list(unknown)
    loads = inputs.loads.copy()
    loads[columns] = 0.0
    state = rod.rest()
    for _ in range(SEARCH_STEPS):
        state, converged = rod.solve(Inputs(inputs.pressures, loads, inputs.gravity), state)
        step = rod.linearise(state, Inputs(inputs.pressures, loads, inputs.gravity))
        if not converged:
            return None
        residual = log(frames.rotations @ np.swapaxes(step.frames.rotations, -1, -2)).ravel()
        slopes = step.motion.reshape(-1, 2, 3, step.motion.shape[-1])[:, 1].reshape(len(residual), -1)
        unit = scale[columns]
        change = np.linalg.lstsq(slopes[:, rod.chambers + np.array(columns)] * unit, residual, rcond=1e-9)[0]
        # No load changes by more than its typical size in one step.
        change *= min(1.0, 1.0 / max(float(np.abs(change).max()), 1e-12))
        loads[columns] += change * unit
        if np.abs(change).max() < 1e-7:
            return loads[columns]
    return None


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean())) if values.size else 0.0

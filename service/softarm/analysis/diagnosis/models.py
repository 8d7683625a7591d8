"""The model that a diagnosis runs on: the calibrated rod where there is one, else finite elements."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arm import build_arm
from softarm.estimator.diagnosis.stage import Model
from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.geometry import Resolution
from softarm.estimator.model import Frames, Inputs, Load
from softarm.estimator.rod import FittedRod, Recipe, fit_rod, sampled_model
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.rod.samples import Plan
from softarm.estimator.simulation import Answers, Arm, Segments, SimulatedArm, linear_motion, section_loads
from softarm.estimator.specimen import Specimen

Floats = NDArray[np.float64]
Answer = tuple[Floats, Floats, Floats, bool]

PRESSURE_GRAIN = 20.0
LOAD_GRAIN = 1e-5
"""Inputs that differ by less [Pa; N, N m, m/s2] are solved once."""
COARSE = {"quadrant_cylinder": Resolution(layers=1)}
"""Meshes of bodies whose usual mesh takes seconds to solve; calibration takes up what they are stiffer by."""
BUDGET = 150.0
"""Seconds for which finite elements are solved at all, so that a diagnosis ends."""
QUICK_RAYS = 14
"""Rays of samples of a rod that nobody fitted before: a diagnosis must end."""
TWIST = (0, 0, 0, 6)
"""Term of a link law that stands for the moment about the arm's axis."""


def quick_rod(specimen: Specimen, tell: Callable[[str], None]) -> FittedRod:
    """Fit a rod to fewer samples than usual, on the spot."""
    recipe = Recipe(plan=Plan(rays=QUICK_RAYS), check=Plan(rays=1, seed=101, pressure=1.0))
    return fit_rod(
        specimen,
        sampled_model(specimen, recipe),
        lambda done, whole: tell(f"fitting the rod, {done} of {whole}"),
        recipe=recipe,
    )


def rod_model(specimen: Specimen, rod: CalibratedRod) -> Model:
    """Diagnose on a calibrated rod of the specimen."""
    rod = rod.with_loads(section_loads(tuple(rod.sections)))
    step = rod.linearise(rod.rest(), Inputs(np.zeros(rod.chambers), np.zeros(len(rod.loads)), np.zeros(3)))
    segments = Segments.of(specimen, tuple(rod.sections), step.frames)

    def arm(scales: Mapping[str, float], torsion: Floats) -> Arm:
        scaled = rod.with_scales({name: f for name, f in scales.items() if name in rod.regions})
        return SimulatedArm(_twisted(scaled, segments, torsion), segments)

    return Model(specimen, tuple(rod.sections), arm, fast=True)


def _twisted(rod: CalibratedRod, segments: Segments, torsion: Floats) -> CalibratedRod:
    """Scale how far each segment twists under a moment about its axis."""
    laws = rod.laws
    term = np.flatnonzero((laws.table == TWIST).all(axis=1))
    if not torsion.any() or not len(term):
        return rod
    coefficients = laws.coefficients.copy()
    for name, more in zip(segments.names, torsion.tolist(), strict=True):
        own = [link for link, region in enumerate(rod.chain.regions) if region == name]
        coefficients[own, term[0], 2] *= 1.0 + more
    return replace(rod, laws=laws._replace(coefficients=coefficients))


@dataclass(frozen=True)
class SparseModel:
    """Finite elements that solve equal inputs only once.

    Args:
        model: The model with ``section_loads``.
        solved: Answers so far by their inputs.
        deadline: Time of ``time.monotonic`` from which inputs that are not solved yet count as lost.
    """

    model: FiniteElementModel
    solved: dict[tuple[int, ...], Answer]
    deadline: float = float("inf")

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections."""
        return tuple(self.model.sections)

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return self.model.loads

    def rest(self) -> FiniteElementState:
        """Give the unloaded state."""
        return self.model.rest()

    def evaluate(self, pressures: Floats, loads: Floats, gravity: Floats) -> Answers:
        """Solve samples with pressures, load amplitudes and gravity of shape (samples, ...)."""
        grains = np.concatenate(
            [
                np.round(pressures / PRESSURE_GRAIN),
                np.round(loads / LOAD_GRAIN),
                np.round(gravity / LOAD_GRAIN),
            ],
            axis=1,
        ).astype(np.int64)
        found = []
        state = self.model.rest()
        for key, p, amplitude, g in zip(map(tuple, grains.tolist()), pressures, loads, gravity, strict=True):
            if key not in self.solved and time.monotonic() > self.deadline:
                self.solved[key] = self._unsolved()
            elif key not in self.solved:
                self.solved[key], state = self._solve(Inputs(p, amplitude, g), state)
            found.append(self.solved[key])
        places, turns, motions, good = zip(*found, strict=True)
        return Answers(
            Frames(np.array(places), np.array(turns)), np.array(motions), np.array(good, dtype=bool)
        )

    def _unsolved(self) -> Answer:
        frames = self.model.section_frames(self.model.rest())
        inputs = self.model.chambers + len(self.model.loads) + 3
        motion = np.zeros((6 * len(self.model.sections), inputs))
        return frames.positions, frames.rotations, motion, False

    def _solve(self, inputs: Inputs, state: FiniteElementState) -> tuple[Answer, FiniteElementState]:
        model = self.model
        state, good = model.solve(inputs, state)
        frames, motion = linear_motion(model, state, inputs)
        answer = (frames.positions, frames.rotations, motion, bool(good))
        return answer, state if good else model.rest()


def finite_element_model(specimen: Specimen) -> Model:
    """Diagnose on finite elements: for arms with few different inputs, or where no rod is at hand."""
    coarse = COARSE.get(specimen.geometry.kind)
    sections = tuple(build_arm(specimen, (), coarse).sections)
    fem = build_arm(specimen, section_loads(sections), coarse)
    segments = Segments.of(specimen, sections, fem.section_frames(fem.rest()))
    deadline = time.monotonic() + BUDGET
    made: dict[tuple[tuple[str, float], ...], Arm] = {}

    def arm(scales: Mapping[str, float], torsion: Floats) -> Arm:  # noqa: ARG001
        known = {name: round(f, 6) for name, f in scales.items() if name in fem.parameters}
        key = tuple(sorted(known.items()))
        if key not in made:
            model = SparseModel(fem.with_scales(known), {}, deadline)
            made[key] = SimulatedArm(model, segments)  # type: ignore[arg-type]
        return made[key]

    return Model(specimen, sections, arm)

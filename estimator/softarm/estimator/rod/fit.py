"""Fits the calibrated rod of a specimen to its finite-element model, and checks it there."""

from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from softarm.estimator.arm import build_arm, default_loads
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.geometry import DEFAULTS
from softarm.estimator.rod.held_out import HeldOutReport, check_rod
from softarm.estimator.rod.local import local_states
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.rod.regression import Form, fit_laws
from softarm.estimator.rod.samples import (
    Progress,
    SamplingPlan,
    draw_samples,
    load_scale,
    rest_twists,
    sampling_loads,
)
from softarm.estimator.rod.stations import cut
from softarm.estimator.rod.symmetry import candidates, verified
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Specimen


@dataclass(frozen=True)
class Recipe:
    """How a rod is fitted and checked.

    Args:
        plan: Where the finite-element model is sampled.
        check: Where the rod is held against it, along rays of another sequence.
        form: Form of the link laws.
        links_per_segment: Links in each soft segment.
    """

    plan: SamplingPlan = field(default_factory=lambda: SamplingPlan(rays=96, stretch=1.7))
    # Inside the box of the fit: a polynomial is not judged at the border of its samples.
    check: SamplingPlan = field(
        default_factory=lambda: SamplingPlan(
            rays=16, seed=101, pressure=1.0, soft=1.25, bend=np.radians(100.0)
        )
    )
    form: Form = field(default_factory=Form)
    links_per_segment: int = 4


@dataclass(frozen=True)
class FittedRod:
    """A rod and the results of its fit.

    Args:
        rod: The rod, with unit stiffness factors and ``softarm.estimator.arm.default_loads``.
        report: Its errors where it was not fitted.
        samples: States of the finite-element model that it was fitted to.
        symmetries: Symmetries of the arm that the fit made use of, the identity included.
    """

    rod: CalibratedRod
    report: HeldOutReport
    samples: int
    symmetries: int


def sampled_model(specimen: Specimen, recipe: Recipe | None = None) -> FiniteElementModel:
    """Build the finite-element model that a rod is fitted to: with a layer of elements for every link.

    In a longer element the strain of a link depends on more than the link's own wrench.

    Raises:
        InputError: The specimen cannot be meshed.
    """
    resolution = DEFAULTS[specimen.geometry.kind]
    layers = max(resolution.layers, (recipe or Recipe()).links_per_segment)
    return build_arm(specimen, resolution=replace(resolution, layers=layers))


def fit_rod(
    specimen: Specimen,
    model: FiniteElementModel,
    progress: Progress | None = None,
    executor: Executor | None = None,
    recipe: Recipe | None = None,
) -> FittedRod:
    """Fit the rod of a specimen as described, without its calibration, which ``adapted`` applies.

    The model is that of ``sampled_model``; its loads and stiffness factors count for nothing. ``progress`` is
    called with the rays done and all of them; the threads of ``executor`` solve the model side by side.
    """
    recipe = recipe or Recipe()
    plan, total = recipe.plan, recipe.plan.rays + 2 * recipe.check.rays
    # At unit stiffness, which `adapted` scales by the calibrated factors.
    model = model.with_loads(sampling_loads(specimen)).with_scales(dict.fromkeys(model.parameters, 1.0))
    stations = cut(specimen, model, recipe.links_per_segment)

    def sampled(done: int, _: int) -> None:
        if progress is not None:
            progress(done, total)

    def checked(done: int, _: int) -> None:
        if progress is not None:
            progress(plan.rays + done, total)

    samples = draw_samples(specimen, model, stations, plan, sampled, executor)
    chain, loads = stations.chain, model.loads
    symmetries = verified(candidates(specimen), loads, rest_twists(model, stations), model.chambers)
    scale = load_scale(specimen, model, stations, plan.rotation)
    size = np.concatenate([np.array(specimen.pressure_limits), scale])
    states = local_states(chain, loads, samples)
    laws = fit_laws(chain, samples, states, size, symmetries, recipe.form)
    rod = CalibratedRod(chain, laws, loads)
    report = check_rod(rod, specimen, model, stations, recipe.check, checked, executor)
    return FittedRod(rod.with_loads(default_loads(specimen)), report, len(samples), len(symmetries))


def adapted(rod: CalibratedRod, specimen: Specimen) -> CalibratedRod:
    """Apply a specimen's section frames and calibrated stiffness to the rod of its shape.

    It is exact where one factor scales all that is elastic in the arm; ``softarm bench rod`` measures its
    error where the fibres keep their stiffness and the segments have factors of their own.
    """
    from_station = np.array([specimen.section(name).frame_origin_m for name in rod.chain.sections])
    from_station[:, 2] -= rod.chain.heights[rod.chain.section_station]
    quaternions = np.array([specimen.section(name).frame_quaternion for name in rod.chain.sections])
    chain = replace(rod.chain, section_offset=from_station, section_rotation=from_quaternions(quaternions))
    scales = {region: specimen.calibration.scale(region) for region in rod.regions}
    return replace(rod, chain=chain, loads=default_loads(specimen)).with_scales(scales)

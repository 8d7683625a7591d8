"""Where the finite elements and the fake arm's chain differ in their answers to forces at two heights."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import section_forces
from softarm.estimator.geometry import DEFAULTS
from softarm.estimator.model import Inputs
from softarm.estimator.specimen import load_specimen
from softarm.fakes.plant.chain import build, rest_stiffness
from softarm.fakes.plant.parameters import sopra

SMALL_N = 0.01
RIGID = 100.0


def chain_ratio() -> float:
    """Return the turn of the intermediate section per force on it, over that per force on the tip.

    A force at the height h bends a joint at z by (h - z) / (E I): Euler and Bernoulli, next to no force.
    """
    arm = sopra()
    joints = [joint for joint in build(arm).joints if joint.segment == 0]
    height = np.array([joint.height for joint in joints])
    compliance = np.array([1.0 / rest_stiffness(arm.segments[0], joint).bending for joint in joints])
    on_section, on_tip = (compliance @ (frame.origin[2] - height) for frame in arm.frames[1:])
    return float(on_section / on_tip)


def elements_ratio(scales: Mapping[str, float]) -> float:
    """Return the same of the elements without gravity, the segments as stiff as a calibration finds them."""
    specimen = load_specimen("sopra")
    resolution = replace(DEFAULTS[specimen.geometry.kind], layers=4)
    model = build_arm(specimen, loads=section_forces(specimen), resolution=resolution)
    model = model.with_scales({"upper": 1.5, "lower": 1.83, **scales})
    turns = []
    for section in ("intermediate", "tip"):
        force = np.array([SMALL_N * (load.name == f"{section}_x") for load in model.loads])
        state, converged = model.solve(Inputs(np.zeros(6), force, np.zeros(3)), model.rest())
        assert converged
        turns.append(model.section_frames(state).rotations[model.sections.index("intermediate"), 0, 2])
    return float(turns[0] / turns[1])


@pytest.mark.parametrize(
    ("stiffness", "low", "high"), [(1.0, 0.97, 0.985), (RIGID, 0.99, 1.0)], ids=["as drawn", "rigid"]
)
def test_elements_and_chain_differ_by_what_the_sections_bend(
    stiffness: float, low: float, high: float
) -> None:
    scales = {"base": stiffness, "intermediate": stiffness}
    assert low < elements_ratio(scales) / chain_ratio() < high

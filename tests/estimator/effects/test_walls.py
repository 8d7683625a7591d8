"""Walls and cords: where the surface is, what a force on it does, and the balance with the arm."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from softarm.estimator.arc import arc_over_chord
from softarm.estimator.effects.placed import signals_of
from softarm.estimator.effects.simulate import Forces
from softarm.estimator.effects.springs import Springs
from softarm.estimator.geometry.outer import outer_radii
from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp
from softarm.estimator.specimen import load_specimen
from tests.estimator.effects.effects_bench import WORLD, drive_of, placed, run
from tests.estimator.simulation.straight_arm import HEIGHTS, SEGMENTS, straight_arm, surface_of

SURFACE = surface_of(SEGMENTS)


def bent(angle: float) -> Frames:
    """Both segments bent towards x into arcs by an angle each."""
    start, position, positions, rotations = 0.0, np.zeros(3), [], []
    for length in np.diff([0.0, *HEIGHTS]):
        chord = length / arc_over_chord(np.array(angle))[0]
        middle = start + 0.5 * angle
        position = position + chord * np.array([np.sin(middle), 0.0, np.cos(middle)])
        start += angle
        positions.append(position)
        rotations.append(exp(np.array([0.0, start, 0.0])))
    return Frames(np.array([positions]), np.array([rotations]))


@pytest.mark.parametrize("angle", [1e-6, 0.4, 1.2])
def test_the_axis_of_a_bent_segment_is_its_arc(angle: float):
    frames = bent(angle)
    points = SURFACE.points(frames.positions, frames.rotations)[0]
    radius = HEIGHTS[0] / angle
    for share, point in zip((0.125, 0.375, 0.625, 0.875), points[:4], strict=True):
        turned = share * angle
        arc = np.array([radius * (1.0 - np.cos(turned)), 0.0, radius * np.sin(turned)])
        assert point == pytest.approx(arc, abs=5e-4)
    assert points[-1] == pytest.approx(frames.positions[0, 1] + 0.005 * frames.rotations[0, 1, :, 2])


def test_the_surface_moves_as_its_gradients_say():
    frames, normal = bent(0.6), np.array([0.6, 0.8, 0.0])
    twist = 1e-6 * np.random.default_rng(0).standard_normal((2, 6))
    gradients = SURFACE.gradients(frames.rotations, normal)
    moved = SURFACE.points(frames.positions + twist[:, :3], exp(twist[:, 3:]) @ frames.rotations)
    change = (moved - SURFACE.points(frames.positions, frames.rotations)) @ normal
    assert change[0] == pytest.approx(np.einsum("psk,sk->p", gradients[0], twist), rel=1e-4, abs=1e-11)


def test_a_force_on_a_beam_moves_its_end_as_its_nodal_loads_do():
    """A cantilever with a lateral force at a distance from the clamp: Euler and Bernoulli."""
    stiffness, length, force = 0.01, HEIGHTS[0], 0.2
    at = 0.375 * length
    wrench = force * SURFACE.gradients(np.tile(np.eye(3), (1, 2, 1, 1)), np.array([1.0, 0.0, 0.0]))[0, 1]
    end, moment = wrench[0, 0], wrench[0, 4]
    assert wrench[1] == pytest.approx(np.zeros(6))
    deflection = end * length**3 / (3.0 * stiffness) + moment * length**2 / (2.0 * stiffness)
    slope = end * length**2 / (2.0 * stiffness) + moment * length / stiffness
    assert deflection == pytest.approx(force * at**2 * (3.0 * length - at) / (6.0 * stiffness))
    assert slope == pytest.approx(force * at**2 / (2.0 * stiffness))


def test_springs_balance_as_nonnegative_least_squares_do():
    rng = np.random.default_rng(1)
    springs, samples = 7, 50
    gradients = rng.standard_normal((samples, springs, 1, 6))
    roots = rng.standard_normal((samples, 6, 6))
    compliance = roots @ np.swapaxes(roots, 1, 2)
    system = Springs(rng.uniform(1.0, 1e4, springs), rng.standard_normal((samples, springs)), gradients)
    forces = system.balanced(np.zeros((samples, springs)), compliance)
    assert (forces > 0.0).any(axis=0).all()
    assert (forces == 0.0).any(axis=0).all()
    for t in range(samples):
        rows = gradients[t, :, 0]
        matrix = rows @ compliance[t] @ rows.T + np.diag(1.0 / system.stiffness)
        root = np.linalg.cholesky(matrix)
        expected, _ = nnls(root.T, np.linalg.solve(root, system.extensions[t]))
        assert forces[t] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_an_unstable_arm_does_not_keep_the_search_from_ending():
    gradients = np.eye(6)[:, None][None]
    unstable = np.diag([1.0, -1.0, 1.0, 1.0, 1.0, -2.0])[None]
    system = Springs(np.full(6, 100.0), np.ones((1, 6)), gradients)
    forces = system.balanced(np.zeros((1, 6)), unstable)
    assert np.isfinite(forces).all()
    assert (forces >= 0.0).all()


def test_a_quarter_of_a_step_that_leaves_three_quarters_to_balance_has_not_stalled():
    effect = placed("contact_obstacle", [40.0, -0.01, 0.0], section="tip")
    drive = drive_of(np.zeros(1), np.zeros((1, 6)))
    arm = straight_arm(drive.time)
    first = Forces.none([effect], drive)
    whole = first.balanced(signals_of(drive, WORLD, arm.respond(drive)), arm.baseline.load_jacobian)
    quarter = replace(whole, forces=whole.forces / 4, wrenches=whole.wrenches / 4, share=np.full(1, 0.25))
    response = arm.respond(replace(drive, wrenches=quarter.wrenches))
    then = quarter.balanced(signals_of(drive, WORLD, response), arm.baseline.load_jacobian)
    assert then.change == pytest.approx(0.75 * whole.change, rel=0.05)
    assert then.share == pytest.approx(0.5)


@pytest.mark.parametrize("stiffness", [30.0, 500.0, 5000.0])
def test_a_wall_along_the_arm_balances_however_stiff_it_is(stiffness: float):
    pressures = np.zeros((12, 6))
    pressures[:, 1] = np.linspace(0.0, 4e4, 12)  # bends the upper segment, and the lower one back
    pressures[:, 3] = np.linspace(0.0, 6e4, 12)
    drive, largest = drive_of(np.arange(12.0), pressures), []
    for azimuth in np.radians(np.arange(0.0, 360.0, 40.0)):
        effect = placed("contact_obstacle", [stiffness, 0.005, azimuth], section="tip")
        done = run(drive, effect)
        assert done.settled
        wrenches, _ = effect.act(signals_of(done.drive, WORLD, done.response), ())
        assert done.drive.wrenches == pytest.approx(wrenches, rel=1e-3, abs=2e-7 * stiffness + 2e-5)
        largest.append(float(np.abs(wrenches).max()))
    assert min(largest) == 0.0
    assert max(largest) > 0.05


def test_a_stiffer_wall_is_entered_less():
    pressures = np.zeros((1, 6))
    pressures[:, 0] = 6e4
    drive = drive_of(np.zeros(1), pressures)
    free = straight_arm(drive.time).respond(drive).frames
    normal = np.sign(free.positions[0, -1, 0]) * np.array([1.0, 0.0, 0.0])
    azimuth = float(np.arctan2(0.0, normal[0]))
    depths = []
    for stiffness in (30.0, 300.0, 3000.0):
        frames = run(
            drive, placed("contact_obstacle", [stiffness, 0.005, azimuth], section="tip")
        ).response.frames
        reach = SURFACE.points(frames.positions, frames.rotations)[0] @ normal
        depths.append(float(reach.max() - 0.005))
    assert depths[0] > depths[1] > depths[2] > 0.0
    assert depths[2] < 2e-3


@pytest.mark.parametrize(("name", "least", "largest"), [("sopra", 0.0156, 0.0277), ("beam", 0.001, 0.1)])
def test_the_outer_radius_is_that_of_the_drawing(name: str, least: float, largest: float):
    specimen = load_specimen(name)
    radii = outer_radii(specimen, np.linspace(0.0, specimen.sections[-1].to_m, 9))
    assert least <= radii.min() <= radii.max() <= largest
    assert np.all(np.diff(radii) <= 0.0)


def test_rotated_frames_of_sections_leave_the_axis_where_it_is():
    turned = replace(
        SEGMENTS, rest=Frames(SEGMENTS.rest.positions, np.tile(exp(np.array([0.3, -0.2, 0.9])), (2, 1, 1)))
    )
    frames = bent(0.5)
    points = surface_of(turned).points(frames.positions, frames.rotations @ turned.rest.rotations)
    assert points == pytest.approx(SURFACE.points(frames.positions, frames.rotations))

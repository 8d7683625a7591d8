import numpy as np
import pytest

from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.accepted import accepted_physics, physics_entry
from softarm.estimator.effects.excitation import inventory
from softarm.estimator.effects.readings import with_offset
from softarm.estimator.effects.world import World
from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp, from_quaternions, log, to_quaternions
from softarm.estimator.simulation import Segments
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.physics import Physics, Place
from tests.estimator.effects.effects_bench import WORLD, placed


def sopra_with(*entries: Physics):
    specimen = load_specimen("sopra")
    return specimen.model_copy(update={"physics": entries})


def creep(**changes) -> Physics:
    entry = physics_entry(placed("viscoelastic_creep", [0.1, 20.0, 0.0], segment="upper"), (0.01, 2.0, 0.01))
    return entry.model_copy(update=changes)


def test_what_is_written_down_is_read_back():
    (effect,) = accepted_physics(sopra_with(creep()), WORLD)
    assert effect.effect is EFFECTS["viscoelastic_creep"]
    assert effect.theta.tolist() == [0.1, 20.0, 0.0]
    assert effect.spot.place == Place(segment="upper")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"where": Place(segment="middle")}, "upper, lower"),
        ({"parameters": {}}, "strength, time_constant"),
        ({"effect": "unknown"}, "no equation"),
    ],
)
def test_what_cannot_act_is_refused(changes: dict, message: str):
    with pytest.raises(InputError, match=message):
        accepted_physics(sopra_with(creep(**changes)), WORLD)


def test_bounds_and_units_are_checked():
    entry = creep()
    strength = entry.parameters["strength"]
    for change, message in ({"value": 9.0}, "out of bounds"), ({"unit": "Pa"}, "unit"):
        wrong = {**entry.parameters, "strength": strength.model_copy(update=change)}
        with pytest.raises(InputError, match=message):
            accepted_physics(sopra_with(creep(parameters=wrong)), WORLD)


def test_a_choice_between_laws_is_one_of_them():
    entry = creep()
    between = {**entry.parameters, "relaxed": entry.parameters["relaxed"].model_copy(update={"value": 0.5})}
    with pytest.raises(InputError, match="stands for no law; give 0 or 1"):
        accepted_physics(sopra_with(creep(parameters=between)), WORLD)


def test_the_world_is_read_from_a_specimen():
    specimen = load_specimen("sopra")
    rest = Frames(
        np.array([specimen.section(name).frame_origin_m for name in ("intermediate", "tip")]),
        np.tile(np.eye(3), (2, 1, 1)),
    )
    segments = Segments.of(specimen, ("intermediate", "tip"), rest)
    world = World.of(specimen, segments, ("intermediate", "tip"), np.ones((2, 4)))
    assert (segments.above, segments.below) == ((-1, 0), (0, 1))
    assert world.chamber_segment == (0, 0, 0, 1, 1, 1)
    assert world.masses.tolist() == [0.020, 0.023]
    assert world.segment_masses.tolist() == [0.160, 0.082]


def test_a_recording_shows_what_it_excites():
    time = np.arange(0.0, 120.0, 0.1)
    pressures = np.zeros((len(time), 6))
    pressures[(time > 30) & (time < 60), 0] = 3e4
    gravity = np.tile([0.0, 0.0, 9.81], (len(time), 1))
    found = inventory(time, pressures, gravity, np.full(6, 65e3))
    assert found == {"motion", "rest", "holds", "pressure_steps"}
    assert not EFFECTS["viscoelastic_creep"].needs - found
    assert EFFECTS["mullins_softening"].needs - found == {"growing_cycles"}
    assert EFFECTS["tip_payload"].needs - found == {"mount_turned"}


def test_triangles_show_rates_amplitudes_and_cycles():
    time = np.arange(0.0, 90.0, 0.1)
    tops = [(0, 10, 1e4), (12, 22, 3e4), (30, 80, 5e4)]
    wave = sum(top * np.maximum(0.0, 1 - np.abs(2 * (time - a) / (b - a) - 1)) for a, b, top in tops)
    pressures = np.zeros((len(time), 3))
    pressures[:, 1] = wave
    found = inventory(time, pressures, np.tile([0.0, 0.0, 9.81], (len(time), 1)), np.full(3, 65e3))
    assert {"two_rates", "two_amplitudes", "growing_cycles", "large_pressures", "small_pressures"} <= found
    assert not found & {"each_chamber", "mount_turned", "long_run", "rest"}


def test_a_pose_keeps_its_place_and_turns_in_its_own_axes():
    turn = np.array([[0.2, -0.1, 0.4]])
    pose = np.concatenate([[[1.0, 2.0, 3.0]], to_quaternions(exp(turn))], axis=1)
    assert np.allclose(with_offset(pose, np.zeros(3)), pose)
    after = with_offset(pose, np.array([0.01, 0.0, 0.0]))
    assert np.array_equal(after[:, :3], pose[:, :3])
    own = exp(-turn) @ from_quaternions(after[:, 3:])
    assert np.allclose(log(own), [[0.01, 0.0, 0.0]])

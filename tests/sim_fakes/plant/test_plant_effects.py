from collections.abc import Callable

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.chain import build
from softarm.fakes.plant.effects import ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS, Concealed, effect
from softarm.fakes.plant.parameters import ArmParameters
from softarm.fakes.plant.state import PlantInputs, PlantState
from tests.sim_fakes.plant.driving import MakeArm, hold, move, pressures

VENTED = PlantInputs(np.zeros(6))
INSIDE = ARM_EFFECTS | FOREIGN_EFFECTS
VOCABULARY = {
    "viscoelastic_creep", "hysteresis", "mullins_softening", "material_softening", "material_stiffening",
    "segment_stiffness", "local_stiffness_defect", "inertia_damping", "tip_payload", "external_force",
    "contact_obstacle", "distributed_mass", "base_tilt", "base_compliance", "tether_stiffness",
    "chamber_gain", "chamber_crosstalk", "pressure_bias", "pressure_saturation", "line_lag", "line_leak",
    "valve_deadband",
    "frame_misalignment", "sensor_bias", "sensor_drift", "sensor_scale", "sensor_latency", "sensor_stuck",
    "thermal_drift", "fibre_twist",
}  # fmt: skip


def shaken(arm: FakeArm) -> PlantState:
    """Bend the arm to one side and on to the other."""
    hold(arm, pressures(c0=40e3, c4=20e3), 0.4)
    return hold(arm, pressures(c1=25e3), 0.4)


def test_the_vocabulary_is_covered_and_the_foreign_effects_lie_outside() -> None:
    assert set(ARM_EFFECTS) | set(INSTRUMENT_EFFECTS) == VOCABULARY
    assert len(FOREIGN_EFFECTS) >= 5
    assert not set(FOREIGN_EFFECTS) & VOCABULARY


@pytest.fixture(scope="module")
def plain_motion(small: object) -> PlantState:
    return shaken(FakeArm(small))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", INSIDE)
def test_an_effect_without_strength_changes_nothing(
    name: str, make_arm: MakeArm, plain_motion: PlantState
) -> None:
    state = shaken(make_arm(Concealed(name, {}, {"strength": 0.0})))
    np.testing.assert_array_equal(state.positions, plain_motion.positions)
    np.testing.assert_array_equal(state.chamber_pressures, plain_motion.chamber_pressures)


@pytest.mark.parametrize("name", sorted(set(INSIDE) - {"mullins_softening", "contact_obstacle"}))
def test_an_effect_of_typical_strength_moves_the_arm(
    name: str, make_arm: MakeArm, plain_motion: PlantState
) -> None:
    state = shaken(make_arm(Concealed(name)))
    assert np.abs(state.positions - plain_motion.positions).max() > 2e-5


def test_silicone_and_connectors_grow_denser_alike(small: ArmParameters) -> None:
    denser = ARM_EFFECTS["distributed_mass"].change(small, {}, {"change": 0.2})
    added = build(denser).model.body_mass.sum() - build(small).model.body_mass.sum()
    own = sum(segment.mass for segment in small.segments) + sum(small.rigid_masses)
    assert added == pytest.approx(0.2 * own)


def bend(state: PlantState, segment: int = 0) -> float:
    return float(np.hypot(*state.bends[segment]))


def creep(arm: FakeArm) -> float:
    early = bend(move(arm, pressures(c0=30e3), 0.5))
    return bend(hold(arm, pressures(c0=30e3), 15.0)) / early - 1.0


def loop(arm: FakeArm) -> float:
    """Difference between the slow ways up and down at half pressure, over the bend."""
    up = [bend(move(arm, pressures(c0=p), 0.5)) for p in np.linspace(0.0, 40e3, 5)][2]
    down = [bend(move(arm, pressures(c0=p), 0.5)) for p in np.linspace(40e3, 0.0, 5)][2]
    return down / up - 1.0


def second_passage(arm: FakeArm) -> float:
    first = bend(move(arm, pressures(c0=20e3), 2.0))
    move(arm, pressures(c0=45e3), 1.0)
    move(arm, VENTED, 2.0)
    return bend(move(arm, pressures(c0=20e3), 2.0)) / first - 1.0


def curve(arm: FakeArm) -> float:
    low = bend(move(arm, pressures(c0=10e3), 2.0)) / 10e3
    return bend(move(arm, pressures(c0=50e3), 2.0)) / 50e3 / low - 1.0


def ring(arm: FakeArm) -> float:
    move(arm, pressures(c0=30e3), 2.0)
    swing = [hold(arm, VENTED, 0.02).bends[0, 0] for _ in range(60)]
    return float(-np.ptp(swing[30:]))


def sideways(arm: FakeArm) -> float:
    return bend(move(arm, PlantInputs(np.zeros(6)), 0.1), 0)


def yaw(arm: FakeArm) -> float:
    state = move(arm, PlantInputs(np.full(6, 30e3)), 1.0)
    return float(2.0 * abs(np.arctan2(*_twist(state))))


def _twist(state: PlantState) -> tuple[float, float]:
    (w, x, y, z), (bw, bx, by, bz) = state.quaternions[2], state.quaternions[0]
    return float(bw * z + bx * y - by * x - bz * w), float(bw * w + bx * x + by * y + bz * z)


def base_turn(arm: FakeArm) -> float:
    before = arm.state.quaternions[0]
    state = hold(arm, pressures(c0=40e3, c3=40e3), 1.0)
    return float(1.0 - abs(before @ state.quaternions[0]))


def chamber_pressure(arm: FakeArm) -> float:
    return float(-hold(arm, pressures(c0=30e3), 0.1).chamber_pressures[0])


def pushed(arm: FakeArm) -> float:
    return float(np.abs(hold(arm, pressures(c1=40e3, c2=40e3), 1.5).external_forces).max())


@pytest.mark.parametrize(
    ("name", "signature", "more_than"),
    [
        ("viscoelastic_creep", creep, 0.03),
        ("hysteresis", loop, 0.03),
        ("mullins_softening", second_passage, 0.03),
        ("material_softening", curve, 0.05),
        ("inertia_damping", ring, 0.01),
        ("base_tilt", sideways, 0.01),
        ("fibre_twist", yaw, 0.01),
        ("base_compliance", base_turn, 1e-6),
        ("line_lag", chamber_pressure, 1e3),
        ("line_leak", chamber_pressure, 1e3),
        ("contact_obstacle", pushed, 0.05),
        ("wall_buckling", curve, 0.05),
    ],
)
def test_an_effect_shows_its_signature(
    name: str, signature: Callable[[FakeArm], float], more_than: float, make_arm: MakeArm
) -> None:
    where = {"chamber": 0} if "line" in name else {}
    assert signature(make_arm(Concealed(name, where))) - signature(make_arm()) > more_than


def test_a_plain_arm_creeps_and_loops_by_a_few_percent(make_arm: MakeArm) -> None:
    assert 0.005 < creep(make_arm()) < 0.05
    assert 0.005 < loop(make_arm()) < 0.06


@pytest.mark.parametrize("name", ["material_stiffening", "curvature_locking", "curvature_area"])
def test_these_flatten_the_response(name: str, make_arm: MakeArm) -> None:
    assert curve(make_arm(Concealed(name))) < curve(make_arm()) - 0.05


def test_a_weak_chamber_is_the_only_weak_one(make_arm: MakeArm) -> None:
    plain, weak = make_arm(), make_arm(Concealed("chamber_gain", {"chamber": 0}))
    same = bend(hold(make_arm(Concealed("chamber_gain", {"chamber": 0})), pressures(c1=25e3), 1.0))
    strong = bend(hold(plain, pressures(c0=25e3), 1.0))
    assert bend(hold(weak, pressures(c0=25e3), 1.0)) < 0.92 * strong
    assert same == pytest.approx(strong, rel=1e-4)


def test_crosstalk_moves_the_other_segment(make_arm: MakeArm) -> None:
    moved = hold(make_arm(Concealed("chamber_crosstalk")), pressures(c3=30e3), 1.0)
    plain = hold(make_arm(), pressures(c3=30e3), 1.0)
    assert plain.bends[0, 0] - moved.bends[0, 0] > np.radians(0.5)


def test_a_switch_acts_without_a_jump_and_can_be_taken_back(make_arm: MakeArm) -> None:
    arm, plain = make_arm(), make_arm()
    for one in (arm, plain):
        move(one, pressures(c0=25e3), 0.5)
    arm.switch("segment_stiffness", {"where": {"segment": "upper"}, "change": 0.3})
    np.testing.assert_allclose(
        hold(arm, pressures(c0=25e3), 0.004).bends, plain.state.bends, atol=np.radians(0.2)
    )
    stiff = bend(hold(arm, pressures(c0=25e3), 1.0))
    assert stiff < 0.93 * bend(hold(plain, pressures(c0=25e3), 1.0))
    arm.switch("segment_stiffness", None)
    assert bend(hold(arm, pressures(c0=25e3), 6.0)) == pytest.approx(bend(plain.state), rel=0.04)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("chamber_gian", 0.1, "chamber_gain"),
        ("chamber_gain", {"where": {"chamber": 7}, "change": 0.1}, "no chamber 7"),
        ("chamber_gain", {"wear": 0.1}, "no parameter 'wear'"),
        ("chamber_gain", {"where": {"segment": "upper"}}, "cannot be placed"),
        ("segment_stiffness", {"where": {"segment": "middle"}}, "no segment 'middle'"),
        ("tip_payload", {"where": {"section": "base"}, "mass": 0.01}, "no moving section"),
        ("tip_payload", "heavy", "value 'heavy'"),
        ("tip_payload", -0.5, "negative mass"),
        ("tip_payload", float("nan"), "finite"),
        ("sensor_bias", 0.1, "acts in an instrument"),
        ("base_tilt", {"where": {"axis": "up"}, "angle": 0.1}, "axis"),
    ],
)
def test_a_wrong_switch_is_told_and_changes_nothing(
    name: str, value: object, told: str, make_arm: MakeArm
) -> None:
    arm = make_arm()
    before = arm.parameters
    with pytest.raises(InputError, match=told):
        arm.switch(name, value)
    assert arm.parameters == before


def test_every_quantity_has_a_range_for_trials() -> None:
    for name in INSIDE | INSTRUMENT_EFFECTS:
        quantities = effect(name).quantities
        assert effect(name).principal in quantities
        for quantity in quantities.values():
            assert quantity.low <= quantity.typical <= quantity.high


def test_an_arm_that_flies_apart_is_told(make_arm: MakeArm) -> None:
    arm = make_arm()
    arm.switch("segment_stiffness", -3.0)
    with pytest.raises(InputError, match="diverged at"):
        hold(arm, pressures(c0=30e3), 10.0)

import pytest

from softarm.page.operator import GRACE_S, Operator, unreachable_note
from softarm_client.commands import Refused
from softarm_client.errors import CommandRefusedError
from softarm_client.modes import Mode
from softarm_client.results import AppliedSetpoint, Hold, Pose, Saved

PRESSURES = (0.0,) * 6
POSES = {
    "a": Pose(pressures_pa=PRESSURES, reachable=True, note="it can"),
    "b": Pose(pressures_pa=PRESSURES, reachable=False, note="12 mm short"),
}


class Client:
    """A service that accepts everything, or whose lease is somebody else's."""

    def __init__(self):
        self.sent, self.lease_is_free = [], True

    def acquire(self):
        if not self.lease_is_free:
            refused = Refused(verb="lease/acquire", code="lease_held", message="held by x", hint="wait")
            raise CommandRefusedError(refused)

    @property
    def teach(self):
        return self

    def _answer(self, verb, mode):
        self.sent.append(verb)
        return AppliedSetpoint(mode=mode, asked_pa=PRESSURES)

    def _held(self, verb, name):
        self.sent.append(verb)
        return Hold(mode=Mode.HOLDING, ramp_s=2.0, **POSES[name].model_dump())

    def arm(self):
        return self._answer("arm", Mode.ARMED)

    def disarm(self):
        return self._answer("disarm", Mode.IDLE)

    def stop(self):
        return self._answer("stop", Mode.FAULTED)

    def start(self):
        return self._answer("teach/start", Mode.TEACH)

    def release(self):
        return self._answer("teach/release", Mode.ARMED)

    def hold(self):
        return self._held("teach/hold", "a")

    def goto(self, name):
        return self._held("teach/goto", name)

    def save(self, name):
        self.sent.append("teach/save")
        return Saved(mode=Mode.HOLDING, name=name, **POSES["b"].model_dump())

    def poses(self):
        return POSES


class Desk:
    def __init__(self):
        self.client, self.now, self.browsers, self.told = Client(), 0.0, 1, []
        self.operator = Operator(self.client, lambda: self.browsers, self.told.append, lambda: self.now)
        self.operator._mode = Mode.IDLE


@pytest.fixture
def desk():
    return Desk()


def test_dead_man_arms_then_teaches_and_ends_with_its_grace(desk):
    desk.operator.press()
    desk.operator.press()
    assert desk.client.sent == ["arm", "teach/start"]
    assert desk.operator.needs_lease
    desk.now += GRACE_S + 0.1
    assert not desk.operator.needs_lease


def test_held_pose_lives_as_long_as_a_browser_shows_it(desk):
    desk.operator.press()
    desk.operator.hold_pose()
    desk.now += 60.0
    assert desk.operator.needs_lease
    desk.browsers = 0
    assert not desk.operator.needs_lease


@pytest.mark.parametrize("end", ["release", "disarm", "stop"])
def test_letting_go_and_stopping_end_the_hold(desk, end):
    desk.operator.hold_pose()
    getattr(desk.operator, end)()
    assert not desk.operator.needs_lease


def test_saved_pose_is_gone_to_from_idle(desk):
    desk.operator.go_to("a")
    assert desk.client.sent == ["arm", "teach/goto"]
    assert desk.operator.needs_lease


def test_poses_out_of_reach_are_told_with_the_reason(desk):
    poses = desk.operator.poses()
    assert [unreachable_note(poses[name]) for name in "ab"] == ["", "12 mm short"]
    desk.operator.go_to("b")
    assert desk.told[-1] == "the arm is HOLDING; 12 mm short"


def test_saved_pose_is_told_by_its_name(desk):
    assert desk.operator.save("pose-1")
    assert desk.told[-1] == "the arm is HOLDING; pose-1 is saved; 12 mm short"


def test_lease_of_another_is_told_and_nothing_is_sent(desk):
    desk.client.lease_is_free = False
    desk.operator.press()
    desk.operator.hold_pose()
    assert desk.client.sent == []
    assert "held by x" in desk.told[-1]

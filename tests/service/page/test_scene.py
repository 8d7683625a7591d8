"""The 3-D view: what is drawn where, and what the loss of the service hides."""

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.page.readings import stress_scale
from softarm.page.scene import COLD, HOT, ArmScene, colours
from softarm.page.server import page_server
from softarm_client.messages import Contact, LoadEstimate, SectionPose, Surface
from tests.service.page.test_playback import arm
from tests.service.page.test_server import free_port

LOAD = LoadEstimate(section="tip", force_n=(0.3, 0.0, 0.0), covariance_n2=tuple(map(tuple, 1e-4 * np.eye(3))))
TIP = SectionPose(section="tip", position_m=(0.05, 0.0, 0.2), quaternion_wxyz=(0.8, 0.6, 0.0, 0.0))
RING = [(0.03, 0.0), (0.0, 0.03), (-0.03, 0.0), (0.0, -0.03)]
SURFACE = Surface(triangles=((0, 1, 4),), rest_m=tuple((x, y, z) for z in (0.0, 0.2) for x, y in RING))
CONTACT = Contact(height_m=0.19, height_std_m=0.01, force_n=(0.3, 0.0), since_unix_ns=1)


def hanging(gravity=9.81):
    return arm(azimuths=(np.pi / 2,), to_m=0.1, gravity_m_s2=(0.0, 0.0, gravity))


@pytest.fixture(scope="module")
def server():
    with page_server("127.0.0.1", free_port(), "page") as opened:
        yield opened


@pytest.fixture
def scene(server):
    return ArmScene(server, SURFACE, hanging())


def node(server, name):
    return server.scene._handle_from_node_name[name]


def test_forces_stay_hidden_while_the_view_is_grey(server, scene):
    scene.show_stale(True)
    scene.show_loads((LOAD,), [TIP])
    scene.show_contact(CONTACT)
    assert not node(server, "/base/live").visible  # and with it whatever is drawn below it
    assert {"/base/live/force/tip", "/base/live/contact"} <= set(server.scene._handle_from_node_name)
    scene.show_stale(False)
    assert node(server, "/base/live").visible


def test_force_starts_at_its_section_with_fifteen_centimetres_a_newton(server, scene):
    scene.show_loads((LOAD,), [TIP])
    start, head = node(server, "/base/live/force/tip").points[0]
    np.testing.assert_allclose(start, TIP.position_m, atol=1e-7)
    np.testing.assert_allclose(head - start, (0.045, 0.0, 0.0), atol=1e-7)
    assert node(server, "/base/live/deviation/tip").radius == pytest.approx(1.5e-3)


def test_contact_is_drawn_around_the_bent_arm_at_its_height(server, scene):
    bent = np.array(SURFACE.rest_m) + np.array([0.02, 0.0, 0.0])
    scene.show_shape(np.column_stack([bent, np.zeros(8)]).astype("<f4").tobytes())
    scene.show_contact(None)
    scene.show_contact(CONTACT)
    ball = node(server, "/base/live/contact")
    np.testing.assert_allclose(ball.position, (0.02, 0.0, 0.2), atol=1e-6)
    assert ball.visible
    assert ball.radius > 0.03
    scene.show_contact(None)
    assert not ball.visible


def test_a_ball_that_moves_is_not_drawn_anew(server, scene):
    """A browser draws a new node at the origin first, so that one made anew with each message stays there."""
    scene.show_contact(CONTACT)
    ball = node(server, "/base/live/contact")
    scene.show_contact(CONTACT.model_copy(update={"height_m": 0.0}))
    assert node(server, "/base/live/contact") is ball
    np.testing.assert_allclose(ball.position, (0.0, 0.0, 0.0), atol=1e-6)


def test_sections_follow_their_poses_and_chambers_are_numbered_at_their_azimuth(server, scene):
    scene.show_sections([TIP])
    np.testing.assert_allclose(node(server, "/base/section/tip").position, TIP.position_m)
    label = node(server, "/base/section/base/chamber-0")
    assert label.text == "0"
    assert label.position[1] > 0.03
    assert abs(label.position[0]) < 1e-9


def test_saved_pose_is_a_ghost_until_none_is_chosen(server, scene):
    scene.show_ghost((TIP,))
    np.testing.assert_allclose(node(server, "/base/ghost/frames").batched_positions, [TIP.position_m])
    scene.show_ghost(())
    assert not node(server, "/base/ghost").visible


@pytest.mark.parametrize(("gravity", "down"), [(9.81, -1.0), (-9.81, 1.0)])
def test_arm_hangs_or_stands_as_gravity_acts(server, gravity, down):
    ArmScene(server, SURFACE, hanging(gravity))
    w, x, y, z = node(server, "/base").wxyz
    assert w * w - x * x - y * y + z * z == down


def test_the_scale_ends_at_the_stress_that_is_drawn_red(scene):
    stress = np.linspace(0.0, 700.0, 8)
    scene.show_surface(np.array(SURFACE.rest_m), stress)
    assert scene.red_stress_pa == pytest.approx(686.0)  # the 98th percentile
    painted = colours(stress)
    np.testing.assert_array_equal(painted[[0, -1]], [COLD, HOT])
    assert "686 kPa" in stress_scale(1e3 * scene.red_stress_pa)

"""The 3-D view while two threads draw in it."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.page.scene import ArmScene
from softarm.page.server import page_server
from softarm_client.messages import LoadEstimate, SectionPose, Surface
from tests.service.page.test_server import free_port

LOAD = LoadEstimate(section="tip", force_n=(0.3, 0.0, 0.0), covariance_n2=((1e-4, 0.0, 0.0),) * 3)
TIP = SectionPose(section="tip", position_m=(0.0, 0.0, 0.27), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0))
SURFACE = Surface(triangles=((0, 1, 2),), rest_m=((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)))


def test_forces_may_be_replaced_while_the_view_turns_grey(monkeypatch):
    with page_server("127.0.0.1", free_port(), "page") as server, ThreadPoolExecutor(1) as other:
        scene = ArmScene(server, SURFACE)
        scene.show_loads([LOAD], [TIP])
        add, greyed = server.scene.add_icosphere, []

        def add_slowly(*words, **fields):
            handle = add(*words, **fields)  # the sphere before is removed, and the new one not yet known
            greyed.append(other.submit(scene.show_stale, True))
            threading.Event().wait(0.2)
            return handle

        monkeypatch.setattr(server.scene, "add_icosphere", add_slowly)
        scene.show_loads([LOAD], [TIP])
        greyed[0].result(5.0)
        assert not any(handle.visible for handle in scene._force_handles.values())

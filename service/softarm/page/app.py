"""The page of an arm that is served: feeds view, panel and controls from the streams."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Generic, TypeVar

import viser

from softarm.page import readings
from softarm.page.controls import Controls
from softarm.page.panel import Panel
from softarm.page.scene import ArmScene
from softarm.page.waiting import ServedArm
from softarm_client import STALE_S
from softarm_client.messages import Estimate, Message, State

Kind = TypeVar("Kind", bound=Message)
REFRESH_S = 0.1


class Page:
    """The operator page of one arm; live within the block.

    Args:
        arm: The arm, and the client of its service.
        server: viser's server, without any content; whoever opened it stops it.
    """

    def __init__(self, arm: ServedArm, server: viser.ViserServer) -> None:
        self._client = arm.client
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._scene = ArmScene(server, arm.surface, arm.specimen)
        self._controls = Controls(server, arm.client, self._scene.show_ghost)
        self._stress = server.gui.add_html("")
        self._panel = Panel(server, arm.specimen)
        self._sections: State | None = None
        self._exit = ExitStack()
        self._closing = threading.Event()
        self._watch = threading.Thread(target=self._watch_age, name="softarm-page-age", daemon=True)

    def __enter__(self) -> "Page":
        arm, enter = self._client, self._exit.enter_context
        enter(arm.states().subscribe(self._controls.operator.update_state))
        enter(arm.states().subscribe(Throttle(self._on_state, REFRESH_S)))
        enter(arm.estimates().subscribe(Throttle(self._on_estimate, REFRESH_S)))
        enter(arm.mismatches().subscribe(Throttle(self._panel.show_mismatch, REFRESH_S)))
        self._exit.enter_context(self._client.subscribe_shape(self._scene.show_shape))
        self._controls.operator.start()
        self._watch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._watch.join()
        self._controls.operator.close()
        self._exit.close()

    def _watch_age(self) -> None:
        """Grey what is shown while the service is not heard."""
        while not self._closing.wait(REFRESH_S):
            age_s = self._client.state_age_s
            self._panel.show_age(age_s)
            self._controls.enable(age_s <= STALE_S)
            self._scene.show_stale(age_s > STALE_S)

    def _on_state(self, state: State) -> None:
        self._sections = state
        self._panel.show_state(state)
        self._controls.show_state(state)
        self._scene.show_sections(state.sections)
        self._stress.content = readings.stress_scale(self._scene.red_stress_pa)

    def _on_estimate(self, estimate: Estimate) -> None:
        self._panel.show_estimate(estimate)
        if self._sections is not None:
            self._scene.show_loads(estimate.loads, self._sections.sections)
            self._scene.show_contact(estimate.contact)


class Throttle(Generic[Kind]):
    """Passes on a message when the last one is old enough: a browser cannot draw a hundred a second."""

    def __init__(self, handler: Callable[[Kind], None], interval_s: float) -> None:
        self._handler = handler
        self._interval_s = interval_s
        self._last = 0.0
        self._lock = threading.Lock()

    def __call__(self, message: Kind) -> None:
        """Pass a message on, unless the last one was a moment ago."""
        now = time.monotonic()
        with self._lock:
            if now - self._last < self._interval_s:
                return
            self._last = now
        self._handler(message)

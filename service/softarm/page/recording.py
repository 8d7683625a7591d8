"""The page of a recording: the arm, its forces and pressures at the time of a slider."""

import threading
import time
from collections.abc import Mapping
from pathlib import PurePath

import numpy as np
import viser
from viser import uplot

from softarm.estimator.recording import Recording
from softarm.page import panel, readings
from softarm.page.body import Body
from softarm.page.controls import WIDTH_PX
from softarm.page.playback import Instant, Playback, bent_surface
from softarm.page.scene import ArmScene
from softarm.page.text import plain
from softarm_client.messages import Surface

REFRESH_S = 0.1
STEP_S = 0.01
KNOWN: Mapping[str, str] = {
    "arm": "Arm",
    "specimen": "Specimen",
    "started": "Started",
    "started_by": "Started by",
    "estimated_with": "Estimated with",
}
"""What is shown of ``recording.toml``."""


class RecordingPage:
    """The page of one recording; live within the block.

    Args:
        recording: It holds estimated poses.
        body: The arm's sections and chambers.
        surface: The arm's surface at rest.
        server: viser's server, without any content; whoever opened it stops it.

    Raises:
        InputError: The recording holds no estimates, or those of another arm.
    """

    def __init__(self, recording: Recording, body: Body, surface: Surface, server: viser.ViserServer) -> None:
        self._playback = playback = Playback(recording, body)
        self._body = body
        self._rest = np.array(surface.rest_m)
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._scene = ArmScene(server, surface, body)
        self._add_controls(server.gui, recording)
        self._add_readings(server.gui)
        self._playing_since: tuple[float, float] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="softarm-playback", daemon=True)
        self._show(playback.times[0])

    def _add_controls(self, gui: viser.GuiApi, recording: Recording) -> None:
        first, last = self._playback.times[[0, -1]]
        known = {
            KNOWN[key]: PurePath(str(recording.info[key])).name for key in KNOWN if key in recording.info
        }
        known |= {"Estimates": f"{len(self._playback.times)}, from {first:.2f} s to {last:.2f} s"}
        facts = "".join(f"<div>{name}: {plain(value)}</div>" for name, value in known.items())
        gui.add_html(readings.reading("about", facts, plain(recording.name)))
        self._slider = gui.add_slider("Time [s]", *_range(first, last), STEP_S, _range(first, last)[0])
        play = gui.add_button("Play / pause", hint="Play in real time; at the end, from the beginning.")
        play.on_click(lambda _: self._play_or_pause())
        gui.main_panel.dock_left()
        gui.main_panel.set_width(WIDTH_PX)

    def _add_readings(self, gui: viser.GuiApi) -> None:
        right = gui.add_panel()
        with right.add_tab("Readings"):
            self._forces = gui.add_html("")
            now = uplot.Series(label="now", stroke="#c21d1d", width=2)
            self._curve = panel.force_curves(gui, self._playback.loads, now)
            self._pressures = gui.add_html("")
        right.dock_right()
        right.set_width(panel.WIDTH_PX)

    def __enter__(self) -> "RecordingPage":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    def _play_or_pause(self) -> None:
        """Play from the slider's time on, or stop there."""
        if self._playing_since is not None:
            self._playing_since = None
            return
        begin_s = self._slider.min if self._slider.value >= self._slider.max else self._slider.value
        self._playing_since = time.monotonic(), begin_s

    def _follow(self) -> None:
        """Show the time of the slider, and move it while the recording plays."""
        shown_s = self._slider.value
        while not self._closing.wait(REFRESH_S):
            playing = self._playing_since
            if playing is not None and self._slider.value != shown_s:  # drawn along by hand
                self._playing_since = playing = time.monotonic(), self._slider.value
            if playing is not None:
                self._advance(*playing)
            if self._slider.value != shown_s:
                shown_s = self._slider.value
                self._show(shown_s)

    def _advance(self, since_s: float, begin_s: float) -> None:
        reached_s = begin_s + time.monotonic() - since_s
        at_s = min(round(reached_s, 2), self._slider.max)
        self._slider.value = at_s  # type: ignore[misc]  # mypy does not find viser's setter
        if reached_s >= self._slider.max:
            self._playing_since = None

    def _show(self, time_s: float) -> None:
        """Show everything at a time of the recording [s]."""
        instant = self._playback.at(time_s)
        points = bent_surface(self._rest, self._body, instant.sections)
        self._scene.show_surface(points, np.zeros(len(points)))
        self._scene.show_sections(instant.sections)
        self._scene.show_loads(instant.loads, instant.sections)
        self._forces.content = readings.forces(instant.loads, instant.sections, _gauges(instant))
        self._pressures.content = readings.pressures(
            {"set-point": instant.setpoints_pa, "measured": instant.measured_pa},
            self._body.pressure_limits_pa,
        )
        self._mark(time_s)

    def _mark(self, time_s: float) -> None:
        """Draw the forces of the whole recording, and a line at a time [s]."""
        times, forces = self._playback.times, self._playback.force_sizes
        at = [int(np.searchsorted(times, time_s))] * 3
        top = max((float(force.max()) for force in forces), default=1.0)
        curves = (np.insert(force, at, np.interp(time_s, times, force)) for force in forces)
        line = np.insert(np.zeros(len(times)), at, (0.0, top, 0.0))
        self._curve.data = (np.insert(times, at, time_s), *curves, line)


def _range(first_s: float, last_s: float) -> tuple[float, float]:
    """Return the ends of the slider, in its steps."""
    begin = round(float(first_s), 2)
    return begin, max(round(float(last_s), 2), begin + STEP_S)


def _gauges(instant: Instant) -> str:
    pulls = (f"{plain(name)} {pull:.3f} N" for name, pull in instant.gauges_n.items() if pull is not None)
    return f"Force gauge: {', '.join(pulls)}." if instant.gauges_n else ""

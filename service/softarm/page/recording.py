"""The page of a recording: the arm, its forces and pressures at the time of a slider, and what happened."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath

import numpy as np
import viser
from viser import uplot

from softarm.estimator.arrays import Floats
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen
from softarm.page import panel, readings
from softarm.page.controls import WIDTH_PX
from softarm.page.playback import Instant, Playback, bent_surface
from softarm.page.player import Player
from softarm.page.scene import ArmScene
from softarm.page.text import plain
from softarm.recordings.events import RecordedEvent
from softarm_client.messages import Surface

KNOWN: Mapping[str, str] = {
    "arm": "Arm",
    "specimen": "Specimen",
    "started": "Started",
    "started_by": "Started by",
    "estimated_with": "Estimated with",
}
"""What is shown of ``recording.toml``."""
NEWEST = 4
"""Number of events that are shown."""
KINDS: Mapping[str, tuple[str, str]] = {
    "mode": ("mode", ""),
    "finding": ("finding", "warning"),
    "finding_cleared": ("no longer", ""),
    "contact_begin": ("contact", ""),
    "contact_end": ("contact", ""),
}
"""Kind of an event in words, and its class of style."""
NOW = uplot.Series(label="now", stroke="#c21d1d", width=2)


class RecordingPage:
    """The page of one recording; live within the block.

    Args:
        recording: It holds estimated poses.
        specimen: The arm.
        surface: The arm's surface at rest.
        server: viser's server, without any content; whoever opened it stops it.
        events: What happened during the recording, in the order of the times.

    Raises:
        InputError: The recording holds no estimates, or those of another arm.
    """

    def __init__(
        self,
        recording: Recording,
        specimen: Specimen,
        surface: Surface,
        server: viser.ViserServer,
        events: Sequence[RecordedEvent] = (),
    ) -> None:
        self._playback = Playback(recording, specimen)
        self._specimen, self._events = specimen, events
        self._rest = np.array(surface.rest_m)
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._scene = ArmScene(server, surface, specimen)
        self._player = self._add_controls(server.gui, recording)
        self._add_readings(server.gui)

    def _add_controls(self, gui: viser.GuiApi, recording: Recording) -> Player:
        first, last = self._playback.span_s
        known = {
            KNOWN[key]: PurePath(str(recording.info[key])).name for key in KNOWN if key in recording.info
        }
        known |= {"Estimates": f"{len(self._playback.times)}, from {first:.2f} s to {last:.2f} s"}
        facts = "".join(f"<div>{name}: {plain(value)}</div>" for name, value in known.items())
        gui.add_html(readings.reading("about", facts, plain(recording.name)))
        player = Player(gui, (first, last), self._show, [event.time_s for event in self._events])
        self._happened = gui.add_html("")
        gui.main_panel.dock_left()
        gui.main_panel.set_width(WIDTH_PX)
        return player

    def _add_readings(self, gui: viser.GuiApi) -> None:
        right = gui.add_panel()
        with right.add_tab("Readings"):
            self._forces = gui.add_html("")
            self._curve = panel.force_curves(gui, self._playback.loads, NOW)
            self._pressures = gui.add_html("")
        right.dock_right()
        right.set_width(panel.WIDTH_PX)

    def __enter__(self) -> "RecordingPage":
        self._player.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._player.__exit__()

    def _show(self, time_s: float) -> None:
        """Show everything at a time of the recording [s]."""
        instant = self._playback.at(time_s)
        points = bent_surface(self._rest, self._specimen, instant.sections)
        self._scene.show_surface(points, np.zeros(len(points)))
        self._scene.show_sections(instant.sections)
        self._scene.show_loads(instant.loads, instant.sections)
        self._forces.content = readings.forces(instant.loads, instant.sections, gauge_note(instant))
        self._pressures.content = readings.pressures(
            {"set-point": instant.setpoints_pa, "measured": instant.measured_pa},
            self._specimen.pressure_limits,
        )
        if self._events:
            self._happened.content = events_until(self._events, time_s)
        self._curve.data = marked(self._playback.times, self._playback.force_sizes, time_s)


def marked(times: Floats, curves: Sequence[Floats], time_s: float) -> tuple[Floats, ...]:
    """Return the data of a plot of curves over time, with one more curve: a line upright at a time [s]."""
    at = [int(np.searchsorted(times, time_s))] * 3
    top = max((float(curve.max()) for curve in curves), default=1.0)
    values = (np.insert(curve, at, np.interp(time_s, times, curve)) for curve in curves)
    line = np.insert(np.zeros(len(times)), at, (0.0, top, 0.0))
    return np.insert(times, at, time_s), *values, line


def events_until(events: Sequence[RecordedEvent], time_s: float) -> str:
    """Write what had happened until a time of the recording [s], the newest first."""
    past = [event for event in events if event.time_s <= time_s][-NEWEST:]
    rows = "".join(f"<div>{_event(event)}</div>" for event in reversed(past))
    return readings.reading("events", rows or "Nothing yet.", f"What happened ({len(events)} events)")


def _event(event: RecordedEvent) -> str:
    kind, style = KINDS.get(event.kind, (plain(event.kind), ""))
    where = "" if event.kind == "mode" else f"{plain(event.where)}: "
    return f'<span class="{style}">{event.time_s:.2f} s, {kind}: {where}{plain(event.text)}</span>'


def gauge_note(instant: Instant) -> str:
    """Write the pull of each force gauge that has read by then."""
    pulls = [f"{plain(name)} {pull:.3f} N" for name, pull in instant.gauges_n.items() if pull is not None]
    return f"Force gauge: {', '.join(pulls)}." if pulls else ""

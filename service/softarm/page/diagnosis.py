"""The page of a diagnosis: what was found, where on the arm, and the mismatch without and with it."""

from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from softarm.analysis.diagnosis import sentences
from softarm.analysis.diagnosis.report import FindingPart, Report
from softarm.estimator.diagnosis import words as effect_words
from softarm.estimator.diagnosis.result import Quantity
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import Place
from softarm.page import panel, readings
from softarm.page.highlight import nodes_at
from softarm.page.mismatch import COLOURS, MismatchOverTime
from softarm.page.playback import Playback, bent_surface
from softarm.page.player import Player
from softarm.page.recording import NOW, marked
from softarm.page.scene import ArmScene
from softarm.page.text import plain
from softarm_client.messages import Surface

WIDTH_PX = 330


class DiagnosisPage:
    """The page of one diagnosis; live within the block.

    Args:
        report: What it found.
        recordings: Those that were diagnosed, one at least, as ``softarm.estimator.diagnosis.motion`` keeps
            them.
        specimen: The arm.
        surface: Its surface at rest.
        server: viser's server, without any content; whoever opened it stops it.
    """

    def __init__(
        self,
        report: Report,
        recordings: Sequence[Recording],
        specimen: Specimen,
        surface: Surface,
        server: viser.ViserServer,
    ) -> None:
        self._specimen, self._rest = specimen, np.array(surface.rest_m)
        self._findings = {
            f"{k}. {sentences.place(one)}": one for k, one in enumerate(report.findings, start=1)
        }
        noise = report.baseline.noise_floor
        self._shown = {
            one.name: (Playback(one, specimen), MismatchOverTime(one, noise)) for one in recordings
        }
        self._current = next(iter(self._shown.values()))
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._scene = ArmScene(server, surface, specimen)
        title = plain(f"Diagnosis of {report.specimen}")
        server.gui.add_html(readings.reading("about", plain(_verdict(report)), title))
        self._player = self._add_time(server.gui)
        self._add_findings(server.gui)
        server.gui.main_panel.dock_left()
        server.gui.main_panel.set_width(WIDTH_PX)
        self._add_mismatch(server.gui)

    def _add_time(self, gui: viser.GuiApi) -> Player:
        recording = gui.add_dropdown("Recording", tuple(self._shown), visible=len(self._shown) > 1)
        recording.on_update(lambda _: self._choose_recording(recording.value))
        return Player(gui, self._current[0].span_s, self._show)

    def _choose_recording(self, name: str) -> None:
        self._current = self._shown[name]
        self._player.begin_anew(self._current[0].span_s)

    def _add_findings(self, gui: viser.GuiApi) -> None:
        titles = tuple(self._findings) or ("none",)
        self._chosen = gui.add_dropdown("Finding", titles, hint="Its place is red in the view.")
        self._chosen.on_update(lambda _: self._show_finding())
        self._finding = gui.add_html("")
        self._show_finding()

    def _show_finding(self) -> None:
        finding = self._findings.get(self._chosen.value)
        place = Place() if finding is None else finding.where
        self._marked = nodes_at(self._rest, self._specimen, place)
        words = "No effect is named." if finding is None else _finding(finding)
        self._finding.content = readings.reading("finding", words, plain(self._chosen.value))
        self._player.show_again()

    def _add_mismatch(self, gui: viser.GuiApi) -> None:
        right = gui.add_panel()
        with right.add_tab("Mismatch"):
            gui.add_html(readings.reading("scale", "Over all channels, in multiples of their noise"))
            series = (uplot.Series(label=which, stroke=colour) for which, colour in COLOURS.items())
            self._curve = panel.curves_over_time(gui, "mismatch", *series, NOW)
            self._channels, self._pressures = gui.add_html(""), gui.add_html("")
        right.dock_right()
        right.set_width(panel.WIDTH_PX)

    def __enter__(self) -> "DiagnosisPage":
        self._player.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._player.__exit__()

    def _show(self, time_s: float) -> None:
        """Show everything at a time of the recording [s]."""
        playback, mismatch = self._current
        instant = playback.at(time_s)
        points = bent_surface(self._rest, self._specimen, instant.sections)
        self._scene.show_surface(points, self._marked.astype(np.float64))
        self._scene.show_sections(instant.sections)
        self._scene.show_note(self._chosen.value, self._marked)
        self._curve.data = marked(playback.recording.time, (mismatch.before, mismatch.after), time_s)
        self._channels.content = mismatch.at(time_s)
        if instant.measured_pa:
            limits = self._specimen.pressure_limits
            self._pressures.content = readings.pressures({"measured": instant.measured_pa}, limits)


def _verdict(report: Report) -> str:
    before, after = report.heldout.normalised_rms_before, report.heldout.normalised_rms_after
    return (
        f"{effect_words.plain(report.verdict).capitalize()}. Error on unseen data: "
        f"{sentences.number(before)} times the noise before, {sentences.number(after)} after."
    )


def _finding(finding: FindingPart) -> str:
    rows = {
        effect_words.plain(name): sentences.quantity(Quantity(**size.model_dump()))
        for name, size in finding.parameters.items()
    }
    if finding.probability is not None:
        rows["probability"] = f"{100.0 * finding.probability:.0f} %"
    table = "".join(f"<tr><td>{plain(n)}</td><td><b>{plain(v)}</b></td></tr>" for n, v in rows.items())
    rivals = "; ".join(map(sentences.place, finding.confusable_with))
    confusable = f"These recordings cannot distinguish it from: {plain(rivals)}." if rivals else ""
    return f"{plain(finding.statement)}<table>{table}</table>{confusable}"

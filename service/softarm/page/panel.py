"""The right side of the page: what the service reports, and the force over time."""

import time
from collections import deque
from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from softarm.estimator.specimen import Specimen
from softarm.page import readings
from softarm_client import STALE_S
from softarm_client.messages import Estimate, Mismatch, State

WIDTH_PX = 400
HISTORY = 300
CURVE_PX = 110
AXIS_PX = 15
ESTIMATE_OLD_S = 1.0
"""The service, too, counts an estimator as failed that has been silent for so long."""
ESTIMATED = ("#forces", "#model", ".uplot-container")
EVERYTHING = (*ESTIMATED, "#stress", "#pressures", "#instruments", "#recording")


class Panel:
    """Mode, forces, pressures, instruments and the test of the model."""

    def __init__(self, server: viser.ViserServer, specimen: Specimen) -> None:
        self._gui = gui = server.gui
        self._limits_pa = specimen.pressure_limits
        self._state: State | None = None
        self._estimate_s = float("-inf")
        self._history: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._named: tuple[str, ...] = ()
        self._curve: viser.GuiUplotHandle | None = None
        panel = gui.add_panel()
        with panel.add_tab("Readings"):
            self._status = gui.add_html(readings.reading("status", "Waiting for the service."))
            self._forces = gui.add_html("")
            self._curves = gui.add_folder(None)
            self._pressures, self._instruments, self._model = (gui.add_html("") for _ in range(3))
            self._beat = gui.add_html("")
        panel.dock_right()
        panel.set_width(WIDTH_PX)

    def show_state(self, state: State) -> None:
        """Show mode, findings, pressures and instruments."""
        self._state = state
        self._status.content = readings.status(state)
        self._pressures.content = readings.pressures(
            {"set-point": state.asked_pa, "applied": state.applied_pa, "measured": state.measured_pa},
            self._limits_pa,
        )
        self._instruments.content = readings.instruments(state)

    def show_age(self, age_s: float) -> None:
        """Grey what is old, and write for how long the service has not been heard.

        Args:
            age_s: Age of the newest state [s].
        """
        now_s = time.monotonic()
        if age_s > STALE_S:
            self._status.content = readings.lost_service(age_s, self._state)
            old: tuple[str, ...] = EVERYTHING
        else:
            old = ESTIMATED if now_s - self._estimate_s > ESTIMATE_OLD_S else ()
        style = f"<style>{','.join(old)}{{filter:grayscale(1);opacity:0.45}}</style>" if old else ""
        self._beat.content = f'<span id="beat" hidden>{2.0 * now_s:.0f}</span>{style}'

    def show_estimate(self, estimate: Estimate) -> None:
        """Show the external forces."""
        self._estimate_s = time.monotonic()
        sections = () if self._state is None else self._state.sections
        self._forces.content = readings.forces(estimate.loads, sections, readings.quality(estimate))
        self._plot(estimate)

    def show_mismatch(self, mismatch: Mismatch) -> None:
        """Show whether model and measurements differ."""
        self._model.content = readings.model(mismatch)

    def _plot(self, estimate: Estimate) -> None:
        """Draw one curve for each section that the estimate names."""
        named = tuple(load.section for load in estimate.loads)
        if named != self._named:
            self._named = named
            self._history.clear()
            if self._curve is not None:
                self._curve.remove()
            with self._curves:
                self._curve = force_curves(self._gui, named) if named else None
        forces = (float(np.linalg.norm(load.force_n)) for load in estimate.loads)
        self._history.append((time.monotonic(), *forces))
        times_s, *curves = np.array(self._history).T
        if self._curve is not None and len(times_s) > 1:
            self._curve.data = (times_s - times_s[-1], *curves)


def force_curves(gui: viser.GuiApi, sections: Sequence[str], *marks: uplot.Series) -> viser.GuiUplotHandle:
    """Add an empty plot of forces over time, one curve for each section in its colour."""
    series = (
        uplot.Series(label=section, stroke=readings.COLOURS[k % len(readings.COLOURS)])
        for k, section in enumerate(sections)
    )
    return curves_over_time(gui, "force [N]", *series, *marks)


def curves_over_time(gui: viser.GuiApi, label: str, *series: uplot.Series) -> viser.GuiUplotHandle:
    """Add an empty plot over time.

    Args:
        gui: viser's widgets.
        label: Quantity and unit of the upright axis.
        series: Its curves.
    """
    axes = (
        uplot.Axis(label="time [s]", labelSize=AXIS_PX, size=2 * AXIS_PX),
        uplot.Axis(label=label, labelSize=AXIS_PX),
    )
    return gui.add_uplot(
        tuple(np.zeros(2) for _ in range(1 + len(series))),
        (uplot.Series(label="time [s]"), *series),
        scales={"x": uplot.Scale(time=False)},
        axes=axes,
        legend=uplot.Legend(show=False),
        height=CURVE_PX,
    )

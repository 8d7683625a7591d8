"""The panel beside the view: mode, health, pressures, plots, and the buttons."""

import threading
import time
from collections import deque
from collections.abc import Mapping

import numpy as np
import viser
from viser import uplot

from softarm.page.operator import Operator
from softarm.page.scene import load_deviation
from softarm.page.text import plain
from softarm_client import STALE_S, Arm
from softarm_client.messages import Estimate, Mismatch, State

HISTORY = 300
HOLD_RATE_HZ = 5.0
NO_POSES = "none yet"
COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b")


class Panel:
    """Texts, plots and buttons.

    Args:
        server: viser's server.
        client: Client of the arm's service.
        chambers: Number of chambers.
    """

    def __init__(self, server: viser.ViserServer, client: Arm, chambers: int) -> None:
        self._operator = Operator(client, lambda: len(server.get_clients()), self._say)
        self._lock = threading.Lock()
        self._times: deque[float] = deque(maxlen=HISTORY)
        self._pressures: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._force_times: deque[float] = deque(maxlen=HISTORY)
        self._forces: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._start = time.monotonic()
        self._state: State | None = None
        self._stale = False
        self._force_sections: tuple[str, ...] = ()
        self._chambers = chambers
        self._buttons(server)  # above all that changes its height: a button must not move under the hand
        self._mode = server.gui.add_markdown("**waiting for the service**")
        self._answer = server.gui.add_markdown("")
        self._reach = server.gui.add_markdown("")
        self._differs = server.gui.add_markdown("")
        self._poses(server)
        with server.gui.add_folder("Pressures [kPa]: asked, applied, measured"):
            self._table = server.gui.add_markdown("")
            empty = (np.zeros(2), *(np.zeros(2) for _ in range(chambers)))
            series = tuple(uplot.Series(label=f"{k}", stroke=COLOURS[k % 6]) for k in range(chambers))
            self._pressure_plot = server.gui.add_uplot(
                empty,
                (uplot.Series(label="s"), *series),
                scales={"x": uplot.Scale(time=False)},
                aspect=2.0,
            )
        with server.gui.add_folder("External force"):
            self._force = server.gui.add_markdown("")
            self._force_plots = server.gui.add_folder("Forces [N] over time [s]")
        self._force_plot: viser.GuiUplotHandle | None = None
        self._server = server
        with server.gui.add_folder("Health"):
            self._health = server.gui.add_markdown("")

    @property
    def operator(self) -> Operator:
        """Acts for whoever sits at the page."""
        return self._operator

    def _say(self, text: str) -> None:
        self._answer.content = plain(text)

    def _buttons(self, server: viser.ViserServer) -> None:
        operator = self._operator
        with server.gui.add_folder("Commands"):
            stop = server.gui.add_button("STOP", color="red", hint="Vents at once; needs no lease.")
            teach = server.gui.add_button(
                "Teach (keep pressed)", color="green", hint="Dead-man: arms, and frees the arm for the hand."
            )
            hold = server.gui.add_button("Hold pose", hint="Ramp to the pressures that hold the pose.")
            release = server.gui.add_button("Release", hint="End teaching or holding; then the arm vents.")
            disarm = server.gui.add_button("Disarm", hint="Vents.")
            clear = server.gui.add_button("Clear", hint="Leaves FAULTED once the cause is gone.")
        self._moving_buttons = [teach, hold, release, disarm, clear]
        stop.on_click(lambda _: operator.stop())
        teach.on_hold(lambda _: operator.press(), callback_hz=HOLD_RATE_HZ)
        hold.on_click(lambda _: operator.hold_pose())
        release.on_click(lambda _: operator.release())
        disarm.on_click(lambda _: operator.disarm())
        clear.on_click(lambda _: operator.clear())

    def _poses(self, server: viser.ViserServer) -> None:
        operator = self._operator
        with server.gui.add_folder("Poses"):
            name = server.gui.add_text("Name", "pose-1")
            save = server.gui.add_button("Save pose", hint="Remember the pose and its pressures.")
            poses = operator.poses()
            known = server.gui.add_dropdown("Saved", tuple(poses) or (NO_POSES,))
            go = server.gui.add_button("Go to", hint="Ramp to the saved pose and hold it.")
            beyond = server.gui.add_markdown(_beyond(poses))

        self._moving_buttons += [save, go]

        def save_pose() -> None:
            if operator.save(name.value):
                poses = operator.poses()
                known.options, beyond.content = tuple(poses) or (NO_POSES,), _beyond(poses)

        save.on_click(lambda _: save_pose())
        go.on_click(lambda _: operator.go_to(known.value))

    def show_state(self, state: State) -> None:
        """Show mode, pressures and health."""
        self._operator.see(state)
        self._state = state
        self._show_mode()
        rows = zip(state.asked_pa, state.applied_pa, state.measured_pa, strict=True)
        lines = [
            f"| {k} | {asked / 1e3:.1f} | {applied / 1e3:.1f} | {_kpa(measured)} |"
            for k, (asked, applied, measured) in enumerate(rows)
        ]
        self._table.content = "\n".join(
            ["| chamber | asked | applied | measured |", "|---|---|---|---|", *lines]
        )
        self._reach.content = plain(state.teach_note or "")
        findings = [
            f"- **{f.severity}** {plain(f.where)}: {plain(f.message)}; {plain(f.hint)}"
            for f in state.findings
        ]
        self._health.content = "\n".join(findings) or "no findings"
        with self._lock:
            self._times.append(time.monotonic() - self._start)
            self._pressures.append(tuple(np.nan if p is None else p / 1e3 for p in state.measured_pa))
            times, pressures = np.array(self._times), np.array(self._pressures)
        if len(times) > 1:
            self._pressure_plot.data = (times, *(pressures[:, k] for k in range(self._chambers)))

    def show_age(self, age_s: float) -> None:
        """Grey what is shown and name its age while the service is not heard; only STOP then works."""
        stale = age_s > STALE_S
        if stale or stale != self._stale:
            self._show_mode(age_s if stale else None)
        if stale and not self._stale:
            for text in (self._table, self._force, self._health, self._reach, self._differs):
                text.content = "unknown"
        if stale != self._stale:
            for button in self._moving_buttons:
                button.disabled = stale
        self._stale = stale

    def _show_mode(self, age_s: float | None = None) -> None:
        state = self._state
        if age_s is not None:
            last = "" if state is None else f", last mode {state.mode}"
            since = "never heard" if np.isinf(age_s) else f"not heard for {age_s:.1f} s"
            self._mode.content = f"## SERVICE {since}{last}"
        elif state is not None:
            cause = f" ({plain(state.fault_cause)})" if state.fault_cause else ""
            holder, recording = plain(state.lease.holder or "free"), plain(state.recording or "no")
            self._mode.content = f"## {state.mode}{cause}\nlease: {holder}, recording: {recording}"

    def show_estimate(self, estimate: Estimate) -> None:
        """Show the external forces."""
        place = estimate.contact
        lines = [
            f"{plain(load.section)}: {np.linalg.norm(load.force_n):.3f} N ± {load_deviation(load):.3f}"
            for load in estimate.loads
        ]
        contact = "contact" if estimate.in_contact else "no contact"
        if place is not None:
            contact += f" {1e3 * place.height_m:.0f} ± {1e3 * place.height_std_m:.0f} mm from the base"
        lost = f"; lost: {plain(', '.join(estimate.sensors_lost))}" if estimate.sensors_lost else ""
        timing = f"{estimate.status}, {1e3 * estimate.latency_s:.0f} ms old{lost}"
        self._force.content = "  \n".join([contact, *lines, timing])
        self._plot_forces(estimate)

    def _plot_forces(self, estimate: Estimate) -> None:
        """Draw one curve for each section that the estimate names."""
        sections = tuple(load.section for load in estimate.loads)
        with self._lock:
            if sections != self._force_sections:
                self._force_sections = sections
                self._force_times.clear()
                self._forces.clear()
                self._force_plot = self._new_force_plot(sections)
            self._force_times.append(time.monotonic() - self._start)
            self._forces.append(tuple(float(np.linalg.norm(load.force_n)) for load in estimate.loads))
            times, forces = np.array(self._force_times), np.array(self._forces)
            if self._force_plot is not None and len(times) > 1:
                self._force_plot.data = (times, *(forces[:, k] for k in range(len(sections))))

    def _new_force_plot(self, sections: tuple[str, ...]) -> viser.GuiUplotHandle | None:
        if self._force_plot is not None:
            self._force_plot.remove()
        if not sections:
            return None
        curves = [
            uplot.Series(label=f"{section} [N]", stroke=COLOURS[k % len(COLOURS)])
            for k, section in enumerate(sections)
        ]
        with self._force_plots:
            return self._server.gui.add_uplot(
                tuple(np.zeros(2) for _ in range(len(sections) + 1)),
                (uplot.Series(label="s"), *curves),
                scales={"x": uplot.Scale(time=False)},
                aspect=2.0,
            )

    def show_mismatch(self, mismatch: Mismatch) -> None:
        """Say when model and measurements differ."""
        where = plain(", ".join(mismatch.where) or "not located")
        advice = plain(mismatch.advice)
        self._differs.content = (
            "" if mismatch.consistent else f"model and measurements differ at {where}: {advice}"
        )


def _beyond(poses: Mapping[str, str]) -> str:
    """List the poses that are out of reach, each with the reason."""
    return "\n".join(f"- {plain(name)}: {plain(why)}" for name, why in poses.items() if why)


def _kpa(pressure: float | None) -> str:
    return "lost" if pressure is None else f"{pressure / 1e3:.1f}"

"""The panel beside the view: mode, health, pressures, plots, and the buttons."""

import threading
import time
from collections import deque
from collections.abc import Mapping

import numpy as np
import viser
from viser import uplot

from softarm.api.messages import Estimate, Mismatch, State
from softarm.client.client import SoftarmClient
from softarm.page.operator import Operator

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

    def __init__(self, server: viser.ViserServer, client: SoftarmClient, chambers: int) -> None:
        self._operator = Operator(client, lambda: len(server.get_clients()), self._say)
        self._lock = threading.Lock()
        self._times: deque[float] = deque(maxlen=HISTORY)
        self._pressures: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._force_times: deque[float] = deque(maxlen=HISTORY)
        self._forces: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._start = time.monotonic()
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
            self._force_plot = server.gui.add_uplot(
                (np.zeros(2), np.zeros(2), np.zeros(2)),
                (
                    uplot.Series(label="s"),
                    uplot.Series(label="intermediate [N]", stroke=COLOURS[0]),
                    uplot.Series(label="tip [N]", stroke=COLOURS[1]),
                ),
                scales={"x": uplot.Scale(time=False)},
                aspect=2.0,
            )
        with server.gui.add_folder("Health"):
            self._health = server.gui.add_markdown("")

    @property
    def operator(self) -> Operator:
        """Acts for whoever sits at the page."""
        return self._operator

    def _say(self, text: str) -> None:
        self._answer.content = text

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
        stop.on_click(lambda _: operator.stop())
        teach.on_hold(lambda _: operator.press(), callback_hz=HOLD_RATE_HZ)
        hold.on_click(lambda _: operator.hold_pose())
        release.on_click(lambda _: operator.let_go("teach/release"))
        disarm.on_click(lambda _: operator.let_go("disarm"))
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

        def save_pose() -> None:
            if operator.send("teach/save", name=name.value):
                poses = operator.poses()
                known.options, beyond.content = tuple(poses) or (NO_POSES,), _beyond(poses)

        save.on_click(lambda _: save_pose())
        go.on_click(lambda _: operator.go_to(known.value))

    def show_state(self, state: State) -> None:
        """Show mode, pressures and health."""
        self._operator.see(state)
        cause = f" ({state.fault_cause})" if state.fault_cause else ""
        holder = state.lease.holder or "free"
        self._mode.content = f"## {state.mode}{cause}\nlease: {holder}, recording: {state.recording or 'no'}"
        rows = zip(state.asked_pa, state.applied_pa, state.measured_pa, strict=True)
        lines = [
            f"| {k} | {asked / 1e3:.1f} | {applied / 1e3:.1f} | {_kpa(measured)} |"
            for k, (asked, applied, measured) in enumerate(rows)
        ]
        self._table.content = "\n".join(
            ["| chamber | asked | applied | measured |", "|---|---|---|---|", *lines]
        )
        self._reach.content = state.teach_note or ""
        findings = [f"- **{f.severity}** {f.where}: {f.message}; {f.hint}" for f in state.findings]
        self._health.content = "\n".join(findings) or "no findings"
        with self._lock:
            self._times.append(time.monotonic() - self._start)
            self._pressures.append(tuple(np.nan if p is None else p / 1e3 for p in state.measured_pa))
            times, pressures = np.array(self._times), np.array(self._pressures)
        if len(times) > 1:
            self._pressure_plot.data = (times, *(pressures[:, k] for k in range(self._chambers)))

    def show_estimate(self, estimate: Estimate) -> None:
        """Show the external forces."""
        place = estimate.contact
        lines = [
            f"{load.section}: {np.linalg.norm(load.force_n):.3f} N "
            f"+- {np.sqrt(sum(row[k] or 0.0 for k, row in enumerate(load.covariance_n2))):.3f}"
            for load in estimate.loads
        ]
        contact = "contact" if estimate.in_contact else "no contact"
        if place is not None:
            contact += f" {1e3 * place.height_m:.0f} +- {1e3 * place.height_std_m:.0f} mm from the base"
        lost = f"; lost: {', '.join(estimate.sensors_lost)}" if estimate.sensors_lost else ""
        timing = f"{estimate.status}, {1e3 * estimate.latency_s:.0f} ms old{lost}"
        self._force.content = "  \n".join([contact, *lines, timing])
        with self._lock:
            self._force_times.append(time.monotonic() - self._start)
            sizes = [float(np.linalg.norm(load.force_n)) for load in estimate.loads]
            self._forces.append((*sizes, np.nan, np.nan)[:2])
            times, forces = np.array(self._force_times), np.array(self._forces)
        if len(times) > 1:
            self._force_plot.data = (times, forces[:, 0], forces[:, 1])

    def show_mismatch(self, mismatch: Mismatch) -> None:
        """Say when model and measurements differ."""
        where = ", ".join(mismatch.where) or "not located"
        self._differs.content = (
            "" if mismatch.consistent else f"model and measurements differ at {where}: {mismatch.advice}"
        )


def _beyond(poses: Mapping[str, str]) -> str:
    """List the poses that are out of reach, each with the reason."""
    return "\n".join(f"- {name}: {why}" for name, why in poses.items() if why)


def _kpa(pressure: float | None) -> str:
    return "lost" if pressure is None else f"{pressure / 1e3:.1f}"

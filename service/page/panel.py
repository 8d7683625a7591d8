"""The panel beside the view: mode, health, pressures, plots, and the buttons."""

import threading
import time
from collections import deque

import numpy as np
import viser
from viser import uplot

from service.api.messages import Estimate, Mismatch, State
from service.network.client import CommandRefusedError, SoftarmClient

HISTORY = 300
HOLD_RATE_HZ = 5.0
COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b")


class Panel:
    """Texts, plots and buttons.

    The dead-man: arming and teaching live as long as a button is held down; letting go ends the renewal of
    the lease, and the service vents by itself.

    Args:
        server: viser's server.
        client: Client of the arm's service.
        chambers: Number of chambers.
    """

    def __init__(self, server: viser.ViserServer, client: SoftarmClient, chambers: int) -> None:
        self._client = client
        self._lock = threading.Lock()
        self._times: deque[float] = deque(maxlen=HISTORY)
        self._pressures: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._force_times: deque[float] = deque(maxlen=HISTORY)
        self._forces: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
        self._start = time.monotonic()
        self._chambers = chambers
        self._mode = server.gui.add_markdown("**waiting for the service**")
        self._buttons(server)
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
        self._answer = server.gui.add_markdown("")

    def _buttons(self, server: viser.ViserServer) -> None:
        with server.gui.add_folder("Commands"):
            stop = server.gui.add_button("STOP", color="red", hint="Vents at once; needs no lease.")
            clear = server.gui.add_button("Clear", hint="Leaves FAULTED once the cause is gone.")
            enable = server.gui.add_button(
                "Hold to enable", color="green", hint="Dead-man: keeps the lease while it is held down."
            )
            teach = server.gui.add_button("Teach", hint="Free the arm and learn the pose; keep the dead-man.")
            hold = server.gui.add_button("Hold pose", hint="Ramp to the pressures that hold the pose.")
            release = server.gui.add_button("Release", hint="End teaching or holding.")
            disarm = server.gui.add_button("Disarm", hint="Vents.")
        stop.on_click(lambda _: self._send("stop"))
        clear.on_click(lambda _: self._send("clear"))
        enable.on_hold(lambda _: self._keep_enabled(), callback_hz=HOLD_RATE_HZ)
        teach.on_click(lambda _: self._send("teach/start"))
        hold.on_click(lambda _: self._send("teach/hold"))
        release.on_click(lambda _: self._send("teach/release"))
        disarm.on_click(lambda _: self._send("disarm"))

    def _keep_enabled(self) -> None:
        try:
            self._client.acquire()
            if self._client.state().mode == "IDLE":
                self._client.command("arm")
        except (CommandRefusedError, TimeoutError) as refusal:
            self._answer.content = f"refused: {refusal}"

    def _send(self, verb: str) -> None:
        try:
            applied = self._client.command(verb)
            self._answer.content = f"{verb}: {applied.mode}"
        except (CommandRefusedError, TimeoutError, ValueError) as refusal:
            self._answer.content = f"refused: {refusal}"

    def show_state(self, state: State) -> None:
        """Show mode, pressures and health."""
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
        lines = [
            f"{load.section}: {np.linalg.norm(load.force_n):.3f} N "
            f"+- {np.sqrt(max(np.trace(load.covariance_n2), 0.0)):.3f}"
            for load in estimate.loads
        ]
        contact = "contact" if estimate.in_contact else "no contact"
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
        if not mismatch.consistent:
            where = ", ".join(mismatch.where) or "not located"
            self._answer.content = f"model and measurements differ at {where}: {mismatch.advice}"


def _kpa(pressure: float | None) -> str:
    return "lost" if pressure is None else f"{pressure / 1e3:.1f}"

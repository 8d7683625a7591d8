"""The left side of the page: what the operator may press, and what the service answered."""

from collections.abc import Callable, Mapping, Sequence

import viser

from softarm.page import readings
from softarm.page.operator import Operator, unreachable_note
from softarm.page.text import plain
from softarm_client import Arm
from softarm_client.messages import SectionPose, State
from softarm_client.results import Pose

WIDTH_PX = 270
HOLD_RATE_HZ = 5.0
NO_POSE = "–"
BUTTONS: tuple[tuple[str, str, Callable[[Operator], None]], ...] = (
    ("Hold pose", "Ramp to the pressures that hold the pose.", Operator.hold_pose),
    ("Release", "End teaching or holding; then the arm vents.", Operator.release),
    ("Disarm", "Vent.", Operator.disarm),
    ("Clear", "Leave FAULTED once the cause is gone.", Operator.clear),
    ("Tare", "Take the present external force as zero.", Operator.tare),
)


class Controls:
    """Buttons, saved poses and the recording."""

    def __init__(
        self, server: viser.ViserServer, client: Arm, show_pose: Callable[[Sequence[SectionPose]], None]
    ) -> None:
        gui = server.gui
        self._show_pose = show_pose
        self._operator = operator = Operator(client, lambda: len(server.get_clients()), self._notify)
        stop = gui.add_command("STOP", description="Vent at once; needs no lease.", hotkey="escape")
        stop.on_trigger(lambda _: operator.stop())
        teach = gui.add_button(
            "Teach (keep pressed)",
            color="green",
            hint="Dead-man's switch: arms, and lets you move the arm by hand.",
        )
        teach.on_hold(lambda _: operator.press(), callback_hz=HOLD_RATE_HZ)
        self._inputs = [teach, *(self._button(gui, *button) for button in BUTTONS)]
        self._poses(gui)
        self._recordings(gui)
        self._answer = gui.add_html("")
        gui.main_panel.dock_left()
        gui.main_panel.set_width(WIDTH_PX)

    def _button(
        self, gui: viser.GuiApi, label: str, hint: str, action: Callable[[Operator], None]
    ) -> viser.GuiButtonHandle:
        button = gui.add_button(label, hint=hint)
        button.on_click(lambda _: action(self._operator))
        return button

    def _poses(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Poses"):
            name = gui.add_text("New pose", "pose-1")
            save = gui.add_button("Save pose", hint="Remember the pose and its pressures.")
            self._saved = gui.add_dropdown("Saved", (NO_POSE,), hint="Drawn as a grey line in the view.")
            go = gui.add_button("Go to", hint="Ramp to the saved pose and hold it.")
            self._beyond = gui.add_html("")
        self._inputs += [save, go]
        save.on_click(lambda _: self._save(name.value))
        go.on_click(lambda _: self._operator.go_to(self._saved.value))
        self._saved.on_update(lambda _: self._show_chosen())
        self._known: Mapping[str, Pose] = {}
        self._list_poses()

    def _save(self, name: str) -> None:
        if self._operator.save(name):
            self._list_poses()
            self._saved.value = name  # type: ignore[misc]  # mypy does not find viser's setter

    def _list_poses(self) -> None:
        self._known = self._operator.poses()
        self._saved.options = (NO_POSE, *self._known)

    def _show_chosen(self) -> None:
        pose = self._known.get(self._saved.value)
        short = "" if pose is None else unreachable_note(pose)
        self._beyond.content = readings.reading("beyond", f'<span class="warning">{plain(short)}</span>')
        self._show_pose(() if pose is None else pose.sections)

    def _recordings(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Recording"):
            name = gui.add_text("File", "recording")
            start = gui.add_button("Start recording", hint="Write every stream to a file from now on.")
            end = self._button(gui, "End recording", "Its file is then complete.", Operator.end_recording)
            self._recording = gui.add_html("")
        self._inputs += [start, end]
        start.on_click(lambda _: self._operator.record(name.value))

    @property
    def operator(self) -> Operator:
        """Acts on behalf of the user of the page."""
        return self._operator

    def _notify(self, text: str) -> None:
        self._answer.content = readings.reading("answer", plain(text))

    def show_state(self, state: State) -> None:
        """Show what is recorded."""
        self._recording.content = readings.recording(state)

    def enable(self, enabled: bool) -> None:
        """Enable or disable everything but STOP."""
        for button in self._inputs:
            button.disabled = not enabled

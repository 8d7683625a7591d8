"""What the operator does through the page: commands, the dead-man, and who keeps the lease."""

import threading
import time
from collections.abc import Callable

from softarm_client import Arm
from softarm_client.errors import CommandRefusedError
from softarm_client.messages import State
from softarm_client.modes import Mode
from softarm_client.results import Pose, Result

GRACE_S = 2.0
"""After the dead-man is let go the lease is renewed for so long: time to press "Hold pose"."""
RENEW_S = 0.2


class Operator:
    """Acts on behalf of the user of the page.

    While the dead-man is pressed the arm is armed and can be taught by hand. Once it is let go, and no pose
    is held, the lease is no longer renewed and the arm vents. A held pose lives as long as a browser shows
    the page.

    Args:
        client: Client of the arm's service.
        browsers: Counts the browsers that show the page.
        notify: Shows one line to the operator.
        clock: Monotonic time [s].
    """

    def __init__(
        self,
        client: Arm,
        browsers: Callable[[], int],
        notify: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._client = client
        self._browsers = browsers
        self._notify = notify
        self._clock = clock
        self._mode: str = Mode.STARTING
        self._pressed_s = float("-inf")
        self._holding = False
        self._acting = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="softarm-operator", daemon=True)

    def start(self) -> None:
        """Begin to renew the lease while it is wanted."""
        self._thread.start()

    def close(self) -> None:
        """Renew no longer."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def update_state(self, state: State) -> None:
        """Keep the newest state of the service."""
        self._mode = state.mode
        if state.mode != Mode.HOLDING:
            self._holding = False

    def press(self) -> None:
        """Handle a sign of life of the dead-man: arm, then teach."""
        if not self._acting.acquire(blocking=False):
            return  # the last one is still being carried out
        try:
            self._pressed_s = self._clock()
            self._enter_teach()
        finally:
            self._acting.release()

    def _enter_teach(self) -> None:
        commands = {Mode.IDLE: self._client.arm, Mode.ARMED: self._client.teach.start}
        if self._mode in commands and self._acquire():
            self._send(commands[Mode(self._mode)])

    def hold_pose(self) -> None:
        """Hold the pose in which the arm is, and keep the lease for it."""
        if self._acquire() and self._send(self._client.teach.hold):
            self._holding = True

    def go_to(self, name: str) -> None:
        """Go to a saved pose and hold it."""
        ready = self._acquire() and (self._mode != Mode.IDLE or self._send(self._client.arm))
        if ready and self._send(lambda: self._client.teach.goto(name)):
            self._holding = True

    def save(self, name: str) -> bool:
        """Save the pose under a name, and return whether it was saved."""
        return self._send(lambda: self._client.teach.save(name), f"{name} is saved")

    def release(self) -> None:
        """End teaching or holding; the lease is no longer renewed."""
        self._let_go(self._client.teach.release)

    def disarm(self) -> None:
        """Vent; the lease is no longer renewed."""
        self._let_go(self._client.disarm)

    def stop(self) -> None:
        """Vent at once."""
        self._let_go(self._client.stop)

    def clear(self) -> None:
        """Leave FAULTED once the cause is gone."""
        self._send(self._client.clear)

    def tare(self) -> None:
        """Tare: count the present external force as zero."""
        self._send(self._client.tare, "the present force counts as zero")

    def record(self, name: str) -> None:
        """Write every stream to a file from now on."""
        self._send(lambda: self._client.recordings.start(name), "the recording has started")

    def end_recording(self) -> None:
        """End the recording; its file is then complete."""
        self._send(self._client.recordings.stop, "the recording has ended")

    def poses(self) -> dict[str, Pose]:
        """Return the saved poses by name; none when the service does not answer."""
        try:
            return self._client.teach.poses()
        except CommandRefusedError:
            return {}

    def _let_go(self, command: Callable[[], Result]) -> None:
        self._pressed_s, self._holding = float("-inf"), False
        self._send(command)

    def _send(self, command: Callable[[], Result], done: str = "") -> bool:
        """Send a command, show its answer and what was done, and return whether it was accepted."""
        try:
            result = command()
        except CommandRefusedError as refusal:
            self._notify(f"refused: {refusal}")
            return False
        self._mode = result.mode
        short = unreachable_note(result) if isinstance(result, Pose) else ""
        self._notify("; ".join(filter(None, (f"the arm is {self._mode}", done, short))))
        return True

    @property
    def needs_lease(self) -> bool:
        """Whether the lease is to be kept."""
        pressed = self._clock() - self._pressed_s < GRACE_S
        return pressed or (self._holding and self._browsers() > 0)

    def _acquire(self) -> bool:
        try:
            self._client.acquire()
        except CommandRefusedError as refusal:
            self._notify(f"refused: {refusal}")
            return False
        return True

    def _keep(self) -> None:
        while not self._stop.wait(RENEW_S):
            if self.needs_lease:
                self._acquire()


def unreachable_note(pose: Pose) -> str:
    """Return why a pose is out of reach, nothing when it is not."""
    return "" if pose.reachable else pose.note

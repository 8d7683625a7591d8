"""A client that teaches poses: take the arm by hand, hold, save, and come back to each.

Run it beside a service: ``python examples/teach_client.py --arm sopra``. Whoever stands at the arm moves it
by hand and presses Return; the arm then holds the pose by itself, and the pose is saved under a name.
Ending the script, or losing it, gives the lease back and the arm vents.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from softarm_client.client import SoftarmClient
from softarm_client.messages import State
from softarm_client.session import DEFAULT_ENDPOINT

RAMP_S = 2.0
SETTLED_PA = 2000.0


def free(client: SoftarmClient) -> State:
    """Let the arm be moved by hand: the pressures that would hold each pose are computed all the while."""
    mode = client.state().mode
    if mode == "IDLE":
        client.command("arm")
    if mode != "TEACH":
        client.command("teach/start")
    return in_mode(client, "TEACH", lambda s: s.teach_pressures_pa is not None, 10.0)


def in_mode(client: SoftarmClient, mode: str, accept: Callable[[State], bool], timeout_s: float) -> State:
    """Wait for a state in a mode.

    Raises:
        RuntimeError: The arm left the mode; the message names the cause.
        TimeoutError: No such state came in time.
    """
    state = client.wait_for("state", State, lambda s: s.mode != mode or accept(s), timeout_s)
    if state.mode != mode:
        raise RuntimeError(f"the arm left {mode} for {state.mode}: {state.fault_cause or 'see its events'}")
    return state


def learn(client: SoftarmClient, name: str, let_go: Callable[[], None]) -> tuple[float, ...]:
    """Hold the pose in which the hand has brought the arm, and save it.

    Args:
        client: The arm's client, with the lease.
        name: Name of the pose.
        let_go: Called when the arm holds by itself and the hand may go.

    Returns:
        Pressures that hold it [Pa], one a chamber.
    """
    answer = client.command("teach/hold", ramp_s=RAMP_S).applied
    if not answer["reachable"]:
        print(f"{name}: not quite within reach: {answer['note']}")
    settle(client)
    let_go()
    settle(client)
    client.command("teach/save", timeout_s=5.0, name=name)
    return client.state().asked_pa


def settle(client: SoftarmClient, timeout_s: float = 10.0) -> State:
    """Wait until the measured pressures are those asked for, after the ramp."""
    time.sleep(RAMP_S)

    def there(state: State) -> bool:
        pairs = zip(state.asked_pa, state.measured_pa, strict=True)
        return all(
            pressure is not None and abs(asked - pressure) < 4 * SETTLED_PA for asked, pressure in pairs
        )

    return in_mode(client, "HOLDING", there, timeout_s)


def replay(client: SoftarmClient, names: list[str]) -> None:
    """Go to saved poses, one after the other."""
    for name in names:
        client.command("teach/goto", name=name, ramp_s=RAMP_S)
        settle(client)


def teach(
    client: SoftarmClient, names: list[str], place: Callable[[str], None], let_go: Callable[[], None]
) -> None:
    """Teach poses one after the other, go through them again, and let the arm go.

    Args:
        client: The arm's client.
        names: Name of each pose.
        place: Returns when the hand has brought the arm into the pose of that name.
        let_go: Called when the arm holds by itself.
    """
    with client.lease():
        for name in names:
            free(client)
            place(name)
            learn(client, name, let_go)
        replay(client, names)
        client.command("teach/release")
        client.command("disarm")


def main() -> None:
    """Teach the poses that the user names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arm", default="sopra")
    parser.add_argument("--endpoint", default=DEFAULT_ENDPOINT)
    parser.add_argument("--zenoh", type=Path, help="JSON5 file with credentials")
    parser.add_argument("names", nargs="*", default=["a", "b"])
    words = parser.parse_args()
    with SoftarmClient(words.arm, words.endpoint, "teach client", words.zenoh) as client:
        teach(
            client,
            words.names,
            lambda name: wait_for_return(f"bring the arm into pose {name}, then press Return "),
            lambda: wait_for_return("the arm holds: let go, then press Return "),
        )


def wait_for_return(text: str) -> None:
    """Ask the user at the terminal."""
    input(text)


if __name__ == "__main__":
    main()

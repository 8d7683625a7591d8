"""``softarm teach``: poses taught by hand, at the terminal."""

from contextlib import suppress
from pathlib import Path

import click

from softarm.cli.output import json_option, notify, show
from softarm.cli.running_arm import arm_options, file_name, hold, leased, seconds_option
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Cell, Table
from softarm_client import Arm
from softarm_client.results import Pose

TEACH_S = 10.0
"""The first pressures of a pose come within this time."""


@click.group(no_args_is_help=True)
def command() -> None:
    """Teach poses by hand, list them, and go to them.

    Example: softarm teach save --arm sopra left right
    """


@command.command("save")
@arm_options
@click.argument("names", nargs=-1, required=True, type=file_name, metavar="NAME...")
@json_option
def save(arm: str, endpoint: str, zenoh_config: Path | None, names: tuple[str, ...], as_json: bool) -> int:
    """Bring the arm by hand into one pose after the other, and save each with the pressures that hold it.

    Press Return when the arm is in place: it then holds the pose by itself. Press Return again after letting
    go: the pose is saved. At the end, and on Ctrl-C, the arm vents.

    Exit status: 0 all saved, 1 refused or the arm faulted, 2 for wrong use, 130 after Ctrl-C.

    Example: softarm teach save --arm sopra left right
    """
    with Arm(arm, endpoint, "softarm teach", zenoh_config=zenoh_config) as running, leased(running):
        running.arm()
        rows = [_taught(running, name) for name in names]
    show(Table(f"Poses of {arm}", rows), as_json=as_json)
    return 0


def _taught(arm: Arm, name: str) -> dict[str, Cell]:
    arm.teach.start()
    _ask(f"move the arm into pose {name}, then press Return")
    state = arm.states().wait_for(lambda s: s.mode != "TEACH" or s.teach_pressures_pa is not None, TEACH_S)
    if state.mode != "TEACH":
        raise WorkFailedError(f"{arm.keys.arm}: left TEACH for {state.mode}: {state.fault_cause}")
    arm.teach.hold()
    _ask("the arm holds: let go, then press Return")
    return _row(name, arm.teach.save(name))


def _ask(text: str) -> None:
    click.prompt(text, default="", show_default=False, prompt_suffix=" ", err=True)


@command.command("list")
@arm_options
@json_option
def list_poses(arm: str, endpoint: str, zenoh_config: Path | None, as_json: bool) -> int:
    """List the saved poses of a running arm.

    Example: softarm teach list --arm sopra
    """
    with Arm(arm, endpoint, "softarm teach", zenoh_config=zenoh_config) as running:
        poses = running.teach.poses()
    show(Table(f"Poses of {arm}", [_row(name, pose) for name, pose in poses.items()]), as_json=as_json)
    return 0


@command.command("goto")
@arm_options
@click.argument("name")
@seconds_option("How long to hold")
@json_option
def goto(
    arm: str, endpoint: str, zenoh_config: Path | None, name: str, seconds: float | None, as_json: bool
) -> int:
    """Ramp to a saved pose, hold it, and vent at the end: after --seconds, or on Ctrl-C.

    Exit status: 0 vented as asked, 1 refused or the arm left HOLDING, 2 for wrong use.

    Example: softarm teach goto --arm sopra left --seconds 10
    """
    with Arm(arm, endpoint, "softarm teach", zenoh_config=zenoh_config) as running:
        with suppress(KeyboardInterrupt), leased(running):
            running.arm()
            pose = running.teach.goto(name)
            notify(f"{arm}: moves to {name}; Ctrl-C vents it")
            hold(running, "HOLDING", seconds)
        show(Table(f"Pose of {arm}", [_row(name, pose)]), as_json=as_json)
    return 0


def _row(name: str, pose: Pose) -> dict[str, Cell]:
    pressures: dict[str, Cell] = {
        f"chamber_{k}_kpa": round(1e-3 * p, 3) for k, p in enumerate(pose.pressures_pa)
    }
    return {"pose": name, "reachable": pose.reachable, **pressures, "note": pose.note or None}

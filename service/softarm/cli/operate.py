"""``softarm arm``, ``stop``, ``clear`` and ``tare``: the verbs of a running arm that need no program."""

from contextlib import suppress
from pathlib import Path

import click

from softarm.cli.output import json_option, notify, show
from softarm.cli.running_arm import arm_options, hold, leased, seconds_option
from softarm.common.tables import Table
from softarm.estimator.errors import InputError
from softarm_client import Arm

LIFETIME_S = 1.0
"""How long a set-point lives: the arm vents soon after this command is killed."""


@click.command()
@arm_options
@click.option(
    "--kpa",
    metavar="P,P,...",
    help="Gauge pressures to hold [kPa], one for each chamber; vented when left out.",
)
@seconds_option("How long to hold")
@json_option
def arm(
    arm: str, endpoint: str, zenoh_config: Path | None, kpa: str | None, seconds: float | None, as_json: bool
) -> int:
    """Arm, hold pressures, and vent again at the end: after --seconds, or on Ctrl-C.

    The command holds the lease. If it is killed, the service vents the arm within two seconds.

    Exit status: 0 vented as asked, 1 refused or the arm left ARMED, 2 for wrong use.

    Example: softarm arm --arm sopra --kpa 20,0,0,0,0,0 --seconds 5
    """
    pressures = None if kpa is None else _pressures(kpa)
    with Arm(arm, endpoint, "softarm arm", zenoh_config=zenoh_config) as running:
        with suppress(KeyboardInterrupt), leased(running):
            running.arm()
            notify(f"{arm}: armed; Ctrl-C vents it")
            hold(running, "ARMED", seconds, lambda: _set(running, pressures))
        _show_mode(running, as_json=as_json)
    return 0


def _set(arm: Arm, pressures: tuple[float, ...] | None) -> None:
    if pressures is not None:
        arm.pressures.set(pressures, LIFETIME_S)


def _pressures(text: str) -> tuple[float, ...]:
    try:
        return tuple(1e3 * float(part) for part in text.split(","))
    except ValueError as error:
        cure = "write numbers with commas between them, such as 20,0,0,0,0,0"
        raise InputError("--kpa", f"{text!r} is not a list of pressures", cure) from error


@click.command()
@arm_options
@json_option
def stop(arm: str, endpoint: str, zenoh_config: Path | None, as_json: bool) -> int:
    """Vent at once and latch a fault, in every mode and whoever holds the lease.

    Exit status: 0 stopped, 1 when no service of this arm answers (then: softarm vent), 2 for wrong use.

    Example: softarm stop --arm sopra
    """
    with Arm(arm, endpoint, "softarm stop", zenoh_config=zenoh_config) as running:
        mode = running.stop().mode
    show(Table(f"Arm {arm}", [{"mode": mode}]), as_json=as_json)
    return 0


@click.command()
@arm_options
@json_option
def clear(arm: str, endpoint: str, zenoh_config: Path | None, as_json: bool) -> int:
    """Leave FAULTED once the cause is gone; the arm stays vented.

    Exit status: 0 cleared, 1 refused (the message names the cause), 2 for wrong use.

    Example: softarm clear --arm sopra
    """
    with Arm(arm, endpoint, "softarm clear", zenoh_config=zenoh_config) as running:
        cleared = running.clear()
    show(Table(f"Arm {arm}", [{"mode": cleared.mode, "cleared": cleared.cleared}]), as_json=as_json)
    return 0


@click.command()
@arm_options
@json_option
def tare(arm: str, endpoint: str, zenoh_config: Path | None, as_json: bool) -> int:
    """Take the present external force as zero.

    Exit status: 0 tared, 1 refused (such as without estimates, or while somebody else holds the lease),
    2 for wrong use.

    Example: softarm tare --arm sopra
    """
    with Arm(arm, endpoint, "softarm tare", zenoh_config=zenoh_config) as running:
        zeros, loads = running.tare().loads_n, running.estimate().loads
    axes = [
        {"section": load.section, "axis": axis}
        for load in loads
        for k, axis in enumerate("xyz")
        if load.covariance_n2[k][k] is not None
    ]
    rows = [axis | {"now_zero_n": zero} for axis, zero in zip(axes, zeros, strict=False)]
    show(Table(f"Tare of {arm}", rows), as_json=as_json)
    return 0


def _show_mode(arm: Arm, *, as_json: bool) -> None:
    """Wait until a disarmed arm is idle, and show its mode."""
    state = arm.states().wait_for(lambda state: state.mode not in ("ARMED", "STOPPING"), 5.0)
    show(Table(f"Arm {arm.keys.arm}", [{"mode": state.mode}]), as_json=as_json)

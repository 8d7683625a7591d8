"""Teach three poses by hand, then replay them: ``python examples/teach_and_replay.py sopra``."""

import sys

from softarm_client import Arm

SETTLED_PA = 8e3


def settle(arm: Arm) -> None:
    """Wait until the measured pressures are those asked for."""
    arm.states().wait_for(
        lambda state: all(
            measured is not None and abs(asked - measured) < SETTLED_PA
            for asked, measured in zip(state.asked_pa, state.measured_pa, strict=True)
        ),
        timeout_s=20.0,
    )


with Arm(*sys.argv[1:]) as arm, arm.lease():
    arm.arm()
    for name in ("one", "two", "three"):
        arm.teach.start()
        input(f"bring the arm into pose {name}, then press Return ")
        arm.states().wait_for(lambda state: state.teach_pressures_pa is not None, timeout_s=10.0)
        arm.teach.hold()
        input("the arm holds: let go, then press Return ")
        arm.teach.save(name)
    for name in ("one", "two", "three"):
        print(name, "within reach:", arm.teach.goto(name).reachable, flush=True)
        settle(arm)
    arm.disarm()

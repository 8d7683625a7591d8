"""Teach three poses by hand, then replay them: ``python examples/teach_and_replay.py sopra``."""

import sys

from softarm_client import Arm

with Arm(*sys.argv[1:]) as arm, arm.lease():
    arm.arm()
    for name in ("one", "two", "three"):
        arm.teach.start()
        input(f"move the arm into pose {name}, then press Return ")
        arm.teach.hold()
        input("the arm holds: let go, then press Return ")
        arm.teach.save(name)
    for name in ("one", "two", "three"):
        print(name, "within reach:", arm.teach.goto(name).reachable, flush=True)
        input("press Return for the next ")

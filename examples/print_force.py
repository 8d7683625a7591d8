"""Print the estimated force: ``python examples/print_force.py sopra tcp/127.0.0.1:7447``."""

import sys

from softarm_client import Arm

with Arm(*sys.argv[1:]) as arm:
    for estimate in arm.estimates():
        for load in estimate.loads:
            print(load.section, *load.force_n, "N", flush=True)

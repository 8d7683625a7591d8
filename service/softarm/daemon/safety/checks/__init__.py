"""The health checks, one file each."""

from softarm.daemon.safety.checks.devices import check_devices
from softarm.daemon.safety.checks.disk import check_disk
from softarm.daemon.safety.checks.estimator import check_estimator
from softarm.daemon.safety.checks.inputs import check_inputs
from softarm.daemon.safety.checks.loop import check_loop
from softarm.daemon.safety.checks.recorder import check_recorder
from softarm.daemon.safety.checks.rod import check_rod
from softarm.daemon.safety.checks.valves import check_valves

ALL_CHECKS = (
    check_valves,
    check_inputs,
    check_devices,
    check_estimator,
    check_recorder,
    check_disk,
    check_loop,
    check_rod,
)

__all__ = [
    "ALL_CHECKS",
    "check_devices",
    "check_disk",
    "check_estimator",
    "check_inputs",
    "check_loop",
    "check_recorder",
    "check_rod",
    "check_valves",
]

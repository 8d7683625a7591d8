"""The health checks, one file each."""

from service.safety.checks.disk import check_disk
from service.safety.checks.estimator import check_estimator
from service.safety.checks.inputs import check_inputs
from service.safety.checks.loop import check_loop
from service.safety.checks.recorder import check_recorder
from service.safety.checks.rod import check_rod
from service.safety.checks.valves import check_valves

ALL_CHECKS = (check_valves, check_inputs, check_estimator, check_recorder, check_disk, check_loop, check_rod)

__all__ = [
    "ALL_CHECKS",
    "check_disk",
    "check_estimator",
    "check_inputs",
    "check_loop",
    "check_recorder",
    "check_rod",
    "check_valves",
]

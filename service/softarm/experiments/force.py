"""The force experiment as the demo shows it: the published estimates beside the gauge, while it runs."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from softarm.estimator.errors import InputError
from softarm.experiments.figures import Cells, Series, pull_figures
from softarm.experiments.live import LiveRig
from softarm.experiments.live_runs import against_the_cord, pull_steps
from softarm.experiments.paper import FORCE_N
from softarm_client.messages import Estimate, State

SECTION = "tip"
"""Section that the cord is tied to."""
STEPS = 8
"""Positions of the gauge, and pressures, at which the force is compared."""
TRAVEL_M = 0.065
"""How far the gauge moves away: to about 0.67 N, the paper's range, on SoPrA."""
RAMP_S, SETTLE_S, WINDOW_S = 0.5, 1.0, 0.5
"""Duration of a change of pressure, wait before each comparison, and the duration that it averages over.

The arm's slowest vibration has a period of about half a second: a ramp of one period leaves little of it.
"""


def compare_forces(
    rig: LiveRig, advance: Callable[[], None], steps: int = STEPS
) -> tuple[dict[str, Series], str]:
    """Run both parts of the experiment and compare estimate and gauge at each step.

    Args:
        rig: The running arm, with the lease.
        advance: Called after each comparison.
        steps: Comparisons in each part.

    Returns:
        Columns ``time_s``, ``gauge_n``, ``estimate_n`` and ``std_n`` by condition, and the recording's path.
    """
    columns = {condition: Series() for condition in FORCE_N}

    def compare(condition: str) -> None:
        for name, value in compared(rig).items():
            columns[condition].setdefault(name, []).append(value)
        advance()

    still, pressurised = FORCE_N
    rig.untie()
    rig.client.tare()
    with rig.recording("force") as paths:
        rig.advance = partial(compare, still)
        pull_steps(rig, SECTION, (0.0,), steps, TRAVEL_M, SETTLE_S)
        rig.advance = partial(compare, pressurised)
        against_the_cord(rig, 0.0, np.linspace(0.0, 1.0, steps), RAMP_S, SETTLE_S)
    return columns, paths[0]


def compared(rig: LiveRig) -> dict[str, float]:
    """Compare the means of the published estimates and of the gauge in the lateral direction of the cord.

    Two lateral forces are estimated at a section; the cord pulls in its own direction u, so that the gauge's
    pull T has the lateral part T |u_xy| along u_xy / |u_xy|.

    Raises:
        InputError: The service publishes no force on the section.
    """
    states: list[State] = []
    estimates: list[Estimate] = []
    with rig.client.states().subscribe(states.append), rig.client.estimates().subscribe(estimates.append):
        rig.wait(WINDOW_S)
    loads = [load for estimate in estimates for load in estimate.loads if load.section == SECTION]
    if not loads:
        raise InputError(rig.client.keys.arm, f"publishes no force on {SECTION}", "see its findings")
    pulls = [pull for state in states if (pull := state.gauges_n.get(SECTION)) is not None]
    cord = rig.hooks[-1].requested_m - rig.position(SECTION)
    unit = cord / np.linalg.norm(cord)
    lateral_part = float(np.linalg.norm(unit[:2]))
    lateral = np.array([unit[0], unit[1], 0.0]) / lateral_part
    # Unknown along the arm only, where `lateral` is 0.
    covariance = np.nan_to_num(np.array(loads[-1].covariance_n2, dtype=float))
    return {
        "time_s": rig.now,
        "gauge_n": float(np.mean(pulls)) * lateral_part if pulls else float("nan"),
        "estimate_n": float(np.mean([load.force_n for load in loads], axis=0) @ lateral),
        "std_n": float(np.sqrt(max(lateral @ covariance @ lateral, 0.0))),
    }


def summary(columns: Mapping[str, Series]) -> list[Cells]:
    """Return one row a condition: error in newtons and in percent of the range, beside the paper's.

    Args:
        columns: What ``compare_forces`` returned.
    """
    rows: list[Cells] = []
    for condition, series in columns.items():
        gauge, estimate, std = (np.array(series[name]) for name in ("gauge_n", "estimate_n", "std_n"))
        paper = FORCE_N[condition]
        rows.append(
            {
                "condition": condition,
                **pull_figures(gauge, estimate - gauge, std),
                "paper_mean_n": paper.mean,
                "paper_max_n": paper.largest,
                "paper_mean_percent": 100.0 * paper.mean / paper.span,
            }
        )
    return rows

"""The paper's force experiment: the estimate of a pull on a cord beside the gauge at its other end."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.experiments.paper import FORCE_N, Published
from softarm.experiments.rig_control import (
    Collector,
    FakeControl,
    MeanEstimate,
    laboratory_of,
    ramp_pressures,
)
from softarm_client import Arm

SECTION = "tip"
"""Section that the cord is tied to."""
DIRECTION = np.array([1.0, 0.0, 0.0])
"""Unit vector from the arm to the gauge, in the base frame."""
CORD_M = 0.30
STEPS = 12
"""Positions of the gauge, and pressures, at which the arm is looked at."""
TRAVEL_M = 0.065
"""How far the gauge moves away: to about 0.67 N, the paper's range, on SoPrA."""
HIGHEST_PA = 40e3
CHAMBERS = (0, 3)
"""Chambers pressurised in the second part: they bend the arm away from the gauge."""
SETTLE_S, LOOK_S = 1.5, 0.5
"""Wait before each look, and its length."""


@dataclass(frozen=True)
class ForceSample:
    """One look.

    Args:
        condition: ``not pressurised`` or ``pressurised``.
        gauge_n: Lateral part of the pull that the gauge shows, along the cord's lateral direction.
        estimate_n: Estimated force in that direction.
        std_n: Its standard deviation.
        pressures_pa: Measured pressures, shape (chambers,).
    """

    condition: str
    gauge_n: float
    estimate_n: float
    std_n: float
    pressures_pa: Floats

    @property
    def error_n(self) -> float:
        """Estimate less gauge."""
        return self.estimate_n - self.gauge_n


def sample(condition: str, mean: MeanEstimate, hook: Floats) -> ForceSample:
    """Compare estimate and gauge in the lateral direction of the cord.

    Two lateral forces are estimated at a section; the cord pulls in its own direction u, so that the gauge's
    pull T has the lateral part T |u_xy| along u_xy / |u_xy|.

    Args:
        condition: Name of the condition.
        mean: Means of the look.
        hook: Where the cord ends, in the base frame [m], shape (3,).
    """
    cord = hook - mean.position_m
    unit = cord / np.linalg.norm(cord)
    share = float(np.linalg.norm(unit[:2]))
    lateral: Floats = np.array([unit[0], unit[1], 0.0]) / share
    covariance = np.nan_to_num(mean.covariance_n2)  # unknown along the arm only, where `lateral` is 0
    variance = float(lateral @ covariance @ lateral)
    std = float(np.sqrt(max(variance, 0.0)))
    return ForceSample(condition, mean.gauge_n * share, float(mean.force_n @ lateral), std, mean.measured_pa)


def run_fake(
    client: Arm, fakes: FakeControl, advance: Callable[[], None], steps: int = STEPS
) -> Iterator[ForceSample]:
    """Run both parts on the fakes: the gauge steps away; then the arm pulls against the cord.

    Args:
        client: The arm's client, with the lease.
        fakes: Control port of the fakes, which moves the gauge.
        advance: Called after each look.
        steps: Looks in each part.
    """
    collector = Collector(client, SECTION)
    rest = collector.observe(LOOK_S).position_m
    for distance in np.linspace(0.0, TRAVEL_M, steps):
        hook = rest + (CORD_M + distance) * DIRECTION
        _tie(fakes, hook)
        yield _look(collector, "not pressurised", hook)
        advance()
    hook = rest + CORD_M * DIRECTION
    _tie(fakes, hook)
    client.arm()
    pressures = [0.0] * len(client.state().measured_pa)
    for pressure in np.linspace(0.0, HIGHEST_PA, steps):
        goal = [pressure if k in CHAMBERS else 0.0 for k in range(len(pressures))]
        ramp_pressures(client, pressures, goal, SETTLE_S)
        pressures = goal
        yield _look(collector, "pressurised", hook)
        advance()
    client.disarm()
    fakes.ask("cord")


def _tie(fakes: FakeControl, hook: Floats) -> None:
    place = laboratory_of(fakes)(hook)
    fakes.ask("cord", section=SECTION, hook_m=place.tolist(), length_m=CORD_M)


def _look(collector: Collector, condition: str, hook: Floats) -> ForceSample:
    """Wait until the arm has settled, and look."""
    collector.observe(SETTLE_S)
    return sample(condition, collector.observe(LOOK_S), hook)


def summary(samples: Sequence[ForceSample]) -> list[dict[str, float | str]]:
    """Return one row a condition: error in newtons and in percent of the range, beside the paper's.

    Args:
        samples: All looks.
    """
    rows: list[dict[str, float | str]] = []
    for condition, paper in FORCE_N.items():
        chosen = [s for s in samples if s.condition == condition]
        if chosen:
            rows.append({"condition": condition, **_figures(chosen), **_paper(paper)})
    return rows


def _figures(samples: Sequence[ForceSample]) -> dict[str, float | str]:
    errors = np.abs([s.error_n for s in samples])
    span = float(np.ptp([s.gauge_n for s in samples]))
    return {
        "range_n": span,
        "min_n": float(errors.min()),
        "mean_n": float(errors.mean()),
        "max_n": float(errors.max()),
        "std_n": float(errors.std()),
        "mean_percent": 100.0 * float(errors.mean()) / span if span > 0.0 else float("nan"),
        "inside_2_std": float(np.mean([abs(s.error_n) <= 2.0 * s.std_n for s in samples])),
    }


def _paper(paper: Published) -> dict[str, float | str]:
    return {
        "paper_mean_n": paper.mean,
        "paper_max_n": paper.largest,
        "paper_mean_percent": 100.0 * paper.mean / paper.span,
    }

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


@dataclass(frozen=True)
class ForceSettings:
    """How the experiment is run.

    Args:
        section: Section that the cord is tied to.
        azimuth_rad: Direction in which the gauge stands from the arm, about the base frame's z.
        cord_m: Length of the cord.
        steps: Positions of the gauge, or pressures, at which the arm is looked at.
        travel_m: How far the gauge moves away: to about 0.67 N, the paper's range, on SoPrA.
        chamber_pa: Largest pressure of the pressurised part.
        chambers: Chambers pressurised in it: they bend the arm away from the gauge.
        settle_s: Wait before each look.
        look_s: Length of each look.
    """

    section: str = "tip"
    azimuth_rad: float = 0.0
    cord_m: float = 0.30
    steps: int = 12
    travel_m: float = 0.065
    chamber_pa: float = 40e3
    chambers: tuple[int, ...] = (0, 3)
    settle_s: float = 1.5
    look_s: float = 0.5

    @property
    def direction(self) -> Floats:
        """Unit vector from the arm to the gauge, shape (3,)."""
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad), 0.0])


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


def sample(condition: str, seen: MeanEstimate, hook: Floats | None, direction: Floats) -> ForceSample:
    """Compare estimate and gauge in the lateral direction of the cord.

    Two lateral forces are estimated at a section; the cord pulls in its own direction u, so that the gauge's
    pull T has the lateral part T |u_xy| along u_xy / |u_xy|.

    Args:
        condition: Name of the condition.
        seen: Means of the look.
        hook: Where the cord ends [m]; ``None`` when only its azimuth is known.
        direction: Azimuth of the gauge as a unit vector.
    """
    reach = direction if hook is None else hook - seen.position_m
    unit = reach / np.linalg.norm(reach)
    share = float(np.linalg.norm(unit[:2]))
    lateral: Floats = np.array([unit[0], unit[1], 0.0]) / share
    covariance = np.nan_to_num(seen.covariance_n2)  # unknown along the arm only, where `lateral` is 0
    variance = float(lateral @ covariance @ lateral)
    std = float(np.sqrt(max(variance, 0.0)))
    return ForceSample(condition, seen.gauge_n * share, float(seen.force_n @ lateral), std, seen.measured_pa)


def run_fake(
    client: Arm,
    fakes: FakeControl,
    settings: ForceSettings,
    advance: Callable[[], None],
) -> Iterator[ForceSample]:
    """Run both parts on the fakes: the gauge steps away; then the arm pulls against the cord.

    Args:
        client: The arm's client, with the lease.
        fakes: Control port of the fakes, which moves the gauge.
        settings: How.
        advance: Called after each look.
    """
    collector = Collector(client, settings.section)
    rest = collector.observe(settings.look_s).position_m
    for distance in np.linspace(0.0, settings.travel_m, settings.steps):
        hook = rest + (settings.cord_m + distance) * settings.direction
        _tie(fakes, settings, hook)
        _wait(collector, settings)
        yield sample("not pressurised", collector.observe(settings.look_s), hook, settings.direction)
        advance()
    hook = rest + settings.cord_m * settings.direction
    _tie(fakes, settings, hook)
    client.arm()
    pressures = [0.0] * len(client.state().measured_pa)
    for pressure in np.linspace(0.0, settings.chamber_pa, settings.steps):
        goal = [pressure if k in settings.chambers else 0.0 for k in range(len(pressures))]
        ramp_pressures(client, pressures, goal, settings.settle_s)
        pressures = goal
        _wait(collector, settings)
        yield sample("pressurised", collector.observe(settings.look_s), hook, settings.direction)
        advance()
    client.disarm()
    fakes.ask("cord")


def _tie(fakes: FakeControl, settings: ForceSettings, hook: Floats) -> None:
    place = laboratory_of(fakes)(hook)
    fakes.ask("cord", section=settings.section, hook_m=place.tolist(), length_m=settings.cord_m)


def _wait(collector: Collector, settings: ForceSettings) -> None:
    collector.observe(settings.settle_s)


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

"""Experiments on several fake arms, each in a process of its own, gathered into tables and plots."""

import json
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict
from pathlib import Path

import numpy as np

from softarm.common.processes import processes
from softarm.common.tables import Table
from softarm.estimator.files import write_whole
from softarm.experiments.figures import Cells
from softarm.experiments.seed import FAILED, HAND_MOTIONS, REACHABLE, SeedPlan, SeedResult, run_seed
from softarm.experiments.teaching import CORRECTIONS

EXPERIMENTS = ("calibrate", "validate", "force", "teach")

WAY = (
    "Recorded runs: the fake arm performed each manoeuvre faster than real time, and the estimator of the "
    "service ran over the recording. Seed k is fake arm k: unequal chambers, frames and base misaligned by "
    "up to two degrees, creep, hysteresis and noise at the levels of the real recordings."
)
TITLES = {
    "validation": "Validation of the calibration: poses from pressures alone, at random pressures on two of "
    "three chambers per segment",
    "force": "External force along the cord, from orientations and pressures",
    "sensors": "External force along the cord, by sensors used",
    "beyond": "Beyond the paper: while the arm moves, and at the intermediate section",
    "axial": "Beyond the paper: axial force and torque, from poses",
    "location": "Beyond the paper: where along the arm the cord pulls",
    "teach": "Teach mode: poses set by hand, then held by pressures",
    "comparison": "One calibration for all, compared with the paper's two",
    "unknowns": "The joint calibration",
    "drift": "Drift: scatter in the validation run against the scatter at the calibration",
}
NOTES = {
    "validation": (
        "Held out: calibrated on other recordings. Leave one out: refitted to the other poses of this one.",
    ),
    "force": (
        "Not pressurised: the gauge moves away in about a dozen steps in several directions; the estimates "
        "are those while it rests. Pressurised: pressures ramp up and down in 8 s against the cord; all "
        "estimates count.",
        "Errors are of the lateral part along the cord; range is that of the gauge in the run. The gauge is "
        "averaged over the same window as the readings, and each pull is tared by the rest just before it. "
        "Standard deviations are of the force before the tare, which removes much of the model error.",
    ),
    "beyond": (
        "The calibration used pulls at the tip only. Four unknown loads: two lateral forces on either "
        "section, the pull on the tip alone.",
        "Moving: while the cord lets the vented arm go, the rubber remembers a share of the largest force "
        "since the tare, which the calibration has measured and an estimate leaves out. Few pulls show how "
        "much that share varies, so the standard deviation is too large rather than too small.",
        "Intermediate: pulls on the tip do not determine the stiffness of the sections, which are rigid in "
        "the fake arm and of rubber in the specimen; the estimate of a force there is therefore too large.",
    ),
    "axial": (
        "Cords pull sideways, so no calibration measures the error of an axial force or a torque: their "
        "standard deviations follow from the scatter of the readings alone. Pulls against pressures hardly "
        "twist the arm; the scatter of its torsion is therefore that of free poses. In the finite elements "
        "torsional and bending stiffness share one modulus, while each fake arm has its own torsional "
        "stiffness.",
    ),
    "location": (
        "Fake arm and finite elements both shear, by different laws: the ratio of displacement to rotation "
        "differs, which looks like a contact at another height. The standard deviation includes this error. "
        "Pulls on the tip hardly determine the shear stiffness, which differs from one fake arm to the next; "
        "the location is off accordingly.",
    ),
    "teach": (
        "Errors are of the tip, relative to the pose in which the hand held it. Nearest in reach: mean "
        "distance to the nearest poses that pressures can produce, by the calibrated model.",
    ),
    "comparison": (
        "Errors of the tip. The paper's calibrations include neither misalignments nor gravity nor the "
        "increase of the gains with pressure; its alpha is the factor on both moduli.",
    ),
}
AIMS_NOTE = (
    "Mean error over each run, then over the seeds. Nearest in reach: mean distance to the nearest poses "
    "that pressures can produce, by the calibrated model; only the error beyond it is an error of teach "
    "mode."
)
HAND_MOTIONS_NOTE = (
    "In the lateral runs the hand moves the vented arm sideways. Pressures that bend the arm as far also "
    "lengthen it, so most of these poses cannot be reached. In the other runs the hand stretches the arm as "
    "well. A pose is reachable if pressures bring the calibrated model to within the aims of it."
)
ORDER = tuple(TITLES)


def run_campaign(plans: Sequence[SeedPlan], jobs: int, advance: Callable[[], None]) -> tuple[SeedResult, ...]:
    """Run the seeds, several at a time.

    Args:
        plans: One a seed.
        jobs: Processes at a time; 1 runs here.
        advance: Called after each seed.
    """
    if jobs <= 1 or len(plans) == 1:
        results = []
        for plan in plans:
            results.append(run_seed(plan))
            advance()
        return tuple(results)
    done: dict[int, SeedResult] = {}
    with processes(jobs) as pool:
        waiting = {pool.submit(run_seed, plan): plan.number for plan in plans}
        for future in as_completed(waiting):
            done[waiting[future]] = future.result()
            advance()
    return tuple(done[plan.number] for plan in plans)


def default_jobs(seeds: int) -> int:
    """Choose as many processes as there are seeds and processors."""
    return max(1, min(seeds, len(os.sched_getaffinity(0))))


def tables_of(results: Iterable[SeedResult]) -> tuple[Table, ...]:
    """Join the seeds' rows, each table with its notes."""
    results = tuple(results)
    tables = []
    for name in ORDER:
        rows = [row for result in results for row in result.tables.get(name, [])]
        if rows:
            notes = list(NOTES.get(name, ()))
            if name == "teach":
                notes += [HAND_MOTIONS_NOTE] if "hand_motion" in rows[0] else []
                notes += [f"Seed {r.number}: {note}" for r in results for note in r.notes if "poses" in note]
            tables.append(Table(TITLES[name], rows, tuple(notes)))
    return tuple(tables)


def summary(results: Iterable[SeedResult], way: str = WAY) -> Table:
    """List for each aim what came out over all seeds, and whether it is met."""
    results, rows = tuple(results), list[Cells]()
    joined = [row for result in results for rows in result.tables.values() for row in rows]
    for name, quantity, pick in _AIMS:
        chosen = [row for row in joined if pick(row)]
        if not chosen:
            continue
        key = "mean_percent" if "force" in name else "mean"
        aim = "aim_percent" if "force" in name else "aim"
        values = [value for row in chosen if isinstance(value := row[key], float)]
        goal = next(value for row in chosen if isinstance(value := row[aim], float))
        paper = chosen[0].get("paper_mean_percent" if "force" in name else "paper_mean")
        rows.append(
            {
                "experiment": name,
                "quantity": quantity,
                "seeds": len(values),
                "mean": float(np.mean(values)),
                "worst_seed": float(np.max(values)),
                "paper": paper,
                "nearest_in_reach": _mean(chosen, "nearest_in_reach"),
                "aim": goal,
                "aim_met": bool(np.mean(values) <= goal),
                "inside_2_std": _mean(chosen, "inside_2_std"),
            }
        )
    failures = [f"Seed {r.number}: {note}" for r in results for note in r.notes if FAILED in note]
    return Table("Aims", rows, (AIMS_NOTE, way, *failures))


def _mean(rows: Sequence[Cells], key: str) -> float | None:
    values = [v for row in rows if isinstance(v := row.get(key), float)]
    return float(np.mean(values)) if values else None


def _is_validation(quantity: str) -> Callable[[Cells], bool]:
    return lambda row: (
        row.get("run") == "held out" and row.get("section") == "tip" and row.get("quantity") == quantity
    )


def _is_force(condition: str) -> Callable[[Cells], bool]:
    return lambda row: row.get("condition") == condition and "paper_mean_percent" in row


def _is_teach(quantity: str, motion: str) -> Callable[[Cells], bool]:
    wanted = (f"after {CORRECTIONS} corrections by feedback", quantity, motion)
    return lambda row: (row.get("run"), row.get("quantity"), row.get("hand_motion")) == wanted


_AIMS: tuple[tuple[str, str, Callable[[Cells], bool]], ...] = (
    ("validation", "position [mm]", _is_validation("position")),
    ("validation", "orientation [degrees]", _is_validation("orientation")),
    *(
        ("teach", f"{quantity}, {which} [{unit}]", _is_teach(quantity, motion))
        for motion, which in (
            *((motion, f"{motion} hand motion") for motion in HAND_MOTIONS.values()),
            (REACHABLE, "reachable poses of both"),
        )
        for quantity, unit in (("position", "mm"), ("orientation", "degrees"))
    ),
    ("force", "not pressurised [% of range]", _is_force("not pressurised")),
    ("force", "pressurised [% of range]", _is_force("pressurised")),
)


def write_json(results: Sequence[SeedResult], path: Path, way: str = WAY) -> None:
    """Write every row and every plotted series, and in which way they came about."""
    document = {"schema": "softarm.experiments/1", "way": way, "seeds": [asdict(r) for r in results]}
    write_whole({path: json.dumps(document, indent=1, default=str).encode()})

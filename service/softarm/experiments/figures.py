"""Figures of errors: min, max, mean, standard deviation, share inside two standard deviations."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.experiments.paper import Published

Cells = dict[str, str | int | float | bool | None]
Series = dict[str, list[float]]
"""Columns of a plot by name."""


def error_figures(errors: Floats, unit: str) -> Cells:
    """Return the figures that the paper prints.

    Args:
        errors: Sizes of errors, NaN where lost, shape (samples,).
        unit: Suffix of the headings, such as ``mm``.
    """
    sizes = np.abs(errors[np.isfinite(errors)])
    if not len(sizes):
        return dict.fromkeys((f"{word}_{unit}" for word in ("min", "max", "mean", "std")), None)
    return {
        f"min_{unit}": float(sizes.min()),
        f"max_{unit}": float(sizes.max()),
        f"mean_{unit}": float(sizes.mean()),
        f"std_{unit}": float(sizes.std()),
    }


def with_paper(row: Cells, published: Published, unit: str) -> Cells:
    """Add the paper's figures and the aim to a row that holds ``mean_<unit>``."""
    mean = row[f"mean_{unit}"]
    met = isinstance(mean, float) and mean <= published.aim
    return row | {
        f"paper_mean_{unit}": published.mean,
        f"paper_max_{unit}": published.largest,
        f"aim_{unit}": published.aim,
        "aim_met": met,
    }


def pull_figures(gauge: Floats, error: Floats, std: Floats) -> Cells:
    """Return the range of the gauge and the errors of the force, in newtons and in percent of that range.

    Args:
        gauge: Lateral pulls of the gauge [N], shape (samples,).
        error: Errors of the estimate [N], NaN where lost, shape (samples,).
        std: Its standard deviations [N], shape (samples,).
    """
    span = float(np.ptp(gauge)) if len(gauge) else float("nan")
    row: Cells = {"range_n": span, **error_figures(error, "n")}
    mean = row["mean_n"]
    row["mean_percent"] = 100.0 * mean / span if isinstance(mean, float) and span > 0.0 else None
    row["inside_2_std"] = inside(error, std)
    return row


def without_unit(row: Cells, unit: str) -> Cells:
    """Remove the unit from the headings, for tables whose rows have a unit each."""
    return {key.removesuffix(f"_{unit}"): value for key, value in row.items()}


def inside(errors: Floats, deviations: Floats) -> float:
    """Return the share of errors within two standard deviations; NaN where there is none."""
    valid = np.isfinite(errors) & np.isfinite(deviations)
    if not valid.any():
        return float("nan")
    return float((np.abs(errors[valid]) <= 2.0 * deviations[valid]).mean())

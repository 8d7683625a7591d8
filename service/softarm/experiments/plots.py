"""Plots of the experiments in the paper's form."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from softarm.analysis.plots.figures import save
from softarm.common.tables import Cell
from softarm.experiments.figures import Series
from softarm.experiments.seed import SeedResult


def plot_results(results: Sequence[SeedResult], folder: Path) -> tuple[Path, ...]:
    """Draw each seed's series, one file an experiment and seed."""
    paths = []
    for result in results:
        forces = {name: s for name, s in result.series.items() if name.startswith("force")}
        if forces:
            paths.append(plot_forces(forces, folder / f"force_seed{result.number}.png"))
        if "validation" in result.series:
            figure = _bars(result.series["validation"], ("mm", "degrees"), "pose")
            paths.append(_save(figure, folder / f"validation_seed{result.number}.png"))
        if "teach" in result.series:
            paths.append(_save(_teach(result.series["teach"]), folder / f"teach_seed{result.number}.png"))
    return tuple(paths)


def plot_prediction(rows: Sequence[Mapping[str, Cell]], path: Path) -> Path:
    """Draw how far the old calibration, the fit and its held-out check are off, one panel a unit."""
    units = list(dict.fromkeys(str(row["unit"]) for row in rows))
    figure = Figure(figsize=(4.8 * len(units), 3.2), layout="constrained")
    panels = figure.subplots(1, len(units), squeeze=False)[0]
    for panel, unit in zip(panels, units, strict=True):
        chosen = [row for row in rows if row["unit"] == unit]
        places = np.arange(len(chosen))
        for number, name in enumerate(("old_calibration", "training", "held_out")):
            values = [np.nan if (value := row[name]) is None else float(value) for row in chosen]
            panel.bar(places + 0.27 * number, values, 0.25, label=name.replace("_", " "))
        labels = [f"{row['sensor']} {row['component']}" for row in chosen]
        panel.set_xticks(places + 0.27, labels, rotation=60, ha="right")
        panel.set(ylabel=f"error, rms [{unit}]")
        panel.legend()
    return _save(figure, path)


def plot_forces(series: Mapping[str, Series], path: Path) -> Path:
    """Draw gauge and estimate over time, one panel a condition.

    Args:
        series: Columns ``time_s``, ``gauge_n``, ``estimate_n`` and ``std_n`` by condition.
        path: Where the picture goes.
    """
    figure = Figure(figsize=(5.2 * len(series), 3.2), layout="constrained")
    panels = figure.subplots(1, len(series), squeeze=False)[0]
    for panel, (name, columns) in zip(panels, series.items(), strict=True):
        time, estimate = np.array(columns["time_s"]), np.array(columns["estimate_n"])
        band = 2.0 * np.array(columns["std_n"])
        panel.fill_between(time, estimate - band, estimate + band, color="C1", alpha=0.25, label="2 std")
        panel.plot(time, estimate, "C1-", lw=1.0, label="estimate")
        panel.plot(time, columns["gauge_n"], "k-", lw=1.0, label="gauge")
        panel.set(title=name.removeprefix("force "), xlabel="time [s]", ylabel="lateral force [N]")
        panel.legend()
    return _save(figure, path)


def _save(figure: Figure, path: Path) -> Path:
    with mpl.rc_context({"font.size": 9}):
        return save(figure, path)


def _bars(columns: Series, units: tuple[str, ...], what: str) -> Figure:
    """Draw errors pose by pose, one panel a unit."""
    figure = Figure(figsize=(4.2 * len(units), 3.0), layout="constrained")
    panels = figure.subplots(1, len(units), squeeze=False)[0]
    for panel, unit in zip(panels, units, strict=True):
        _bar(panel, columns[unit], unit, what)
    return figure


def _bar(panel: Axes, values: Sequence[float], unit: str, what: str) -> None:
    panel.bar(np.arange(len(values)), values, color="C0")
    panel.axhline(float(np.nanmean(values)), color="k", lw=0.8, ls="--")
    panel.set(xlabel=what, ylabel=f"error [{unit}]")


def _teach(columns: Series) -> Figure:
    """Draw errors pose by pose, each attempt beside the others."""
    figure = Figure(figsize=(8.4, 3.0), layout="constrained")
    panels = figure.subplots(1, 2, squeeze=False)[0]
    for panel, unit in zip(panels, ("mm", "degrees"), strict=True):
        attempts = [name for name in columns if name.startswith(unit)]
        width = 0.75 / len(attempts)
        for number, name in enumerate(attempts):
            places = np.arange(len(columns[name])) + width * number
            label = "model" if number == 0 else f"{number} corrections"
            panel.bar(places, columns[name], width, label=label)
        panel.set(xlabel="pose", ylabel=f"error [{unit}]")
        if len(attempts) > 1:
            panel.legend()
    return figure

"""Figures without a display, and files of them that appear whole."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from softarm.estimator.files import whole_files

WIDTH = 10.0  # inches
PANEL_HEIGHT = 1.9
DOTS_PER_INCH = 110
FEW_LINES = 8
MM_PER_M = 1e3
KPA_PER_PA = 1e-3


def stacked(rows: int, *, share: bool = True) -> tuple[Figure, list[Axes]]:
    """Make a column of axes over one horizontal axis."""
    figure = blank(WIDTH, 0.7 + PANEL_HEIGHT * rows)
    axes = figure.subplots(rows, 1, sharex=share, squeeze=False)[:, 0]
    return figure, list(axes)


def blank(width: float, height: float) -> Figure:
    """Make a figure without axes, sizes in inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def label(axes: Axes, title: str, unit: str) -> None:
    """Write what axes show; a legend where there is more than one curve."""
    axes.set_title(title, loc="left", fontsize=9)
    axes.set_ylabel(unit, fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, alpha=0.3, linewidth=0.5)
    count = len(axes.get_legend_handles_labels()[1])
    if count > 1:
        columns = 1 if count <= FEW_LINES else 2
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.02), frameon=False, ncols=columns)


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG; an earlier one of the same name is replaced."""
    with whole_files(path) as (draft,), draft.open("wb") as file:
        figure.savefig(file, format="png", dpi=DOTS_PER_INCH)
    return path

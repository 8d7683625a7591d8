"""The figures of a report as SVG images that are part of the page."""

from base64 import b64encode
from collections.abc import Callable, Mapping
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from softarm.analysis.plots.figures import blank
from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.diagnosis.result import CellKind, Exposure, Trace
from softarm.estimator.effects.amounts import readable
from softarm.estimator.series import runs
from softarm.estimator.specimen import Specimen

Shares = Mapping[tuple[CellKind, str], float]
Arguments = ParamSpec("Arguments")

MEASURED, BEFORE, AFTER, SHADE = "#222222", "#d95f02", "#1b7f79", "#dfe7f0"
FEW = 60
"""Points below which each is drawn so that it is seen by itself."""
BINS, LEAST_IN_BIN = 14, 3
ZOOM = 0.08
"""Share of a recording that a zoom shows."""
LEAST_ZOOM = 20
LARGEST_ZOOM = 0.5
"""Fewest samples of a zoom, and the share of a recording from which a zoom shows nothing more."""
STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "softarm",
    "text.parse_math": False,  # names of channels may hold any character
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0.02,
    "axes.ymargin": 0.08,
}
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))


def image(draw: Callable[Arguments, Figure]) -> Callable[Arguments, str]:
    """Make a function that returns a figure return it as the ``data:`` address of an SVG image."""

    @wraps(draw)
    def drawn(*args: Arguments.args, **kwargs: Arguments.kwargs) -> str:
        buffer = BytesIO()
        with mpl.rc_context(STYLE):
            draw(*args, **kwargs).savefig(buffer, format="svg", metadata=NO_METADATA)
        return f"data:image/svg+xml;base64,{b64encode(buffer.getvalue()).decode()}"

    return drawn


@image
def draw_trace(trace: Trace) -> Figure:
    """Draw a channel before and after, its residuals, and of long recordings the worst stretch enlarged."""
    near = worst_window(trace)
    views = [slice(None)]
    if near.stop - near.start < LARGEST_ZOOM * len(trace.time):
        views.append(near)
    figure = blank(10.0, 3.6)
    panels = figure.subplots(
        2,
        len(views),
        sharex="col",
        squeeze=False,
        width_ratios=(2.0, 1.0)[: len(views)],
        height_ratios=(3.0, 2.0),
    )
    for column, view in enumerate(views):
        _draw_view(panels[0, column], panels[1, column], trace, view)
    unit = readable(trace.unit)[1]
    panels[0, 0].set_ylabel(f"[{unit}]")
    panels[1, 0].set_ylabel(f"residual [{unit}]")
    if len(views) > 1:
        panels[0, 1].set_title("largest mismatch, enlarged", fontsize=9, loc="left")
        for axes in panels[:, 0]:
            edge: Any = {"fill": False, "edgecolor": "#777777", "linestyle": ":", "linewidth": 1.0}
            axes.axvspan(trace.time[near][0], trace.time[near][-1], **edge)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3, frameon=False)
    return figure


def _draw_view(upper: Axes, lower: Axes, trace: Trace, view: slice) -> None:
    """Draw some samples of a channel, and their residuals below."""
    factor = readable(trace.unit)[0]
    time = trace.time[view]
    measured, before, after = (factor * v[view] for v in (trace.measured, trace.before, trace.after))
    marker = "." if len(time) <= FEW else ""
    upper.plot(time, measured, color=MEASURED, linewidth=1.4, label="measured", marker=marker)
    upper.plot(time, before, color=BEFORE, linewidth=1.0, label="model before", marker=marker)
    upper.plot(time, after, color=AFTER, linewidth=1.0, label="model after", marker=marker)
    lower.axhline(0.0, color="#888888", linewidth=0.6)
    lower.plot(time, measured - before, color=BEFORE, linewidth=0.9, marker=marker)
    lower.plot(time, measured - after, color=AFTER, linewidth=0.9, marker=marker)
    lower.set_xlabel("time [s]")
    for axes in (upper, lower):
        _shade(axes, time, trace.heldout[view])
        axes.grid(visible=True, alpha=0.3, linewidth=0.5)


def worst_window(trace: Trace) -> slice:
    """Find the samples around the largest mean mismatch before, or after where that is larger."""
    count = len(trace.time)
    width = min(count, max(LEAST_ZOOM, round(ZOOM * count)))
    off = np.nan_to_num(np.maximum((trace.measured - trace.before) ** 2, (trace.measured - trace.after) ** 2))
    sums = np.concatenate([[0.0], np.cumsum(off)])
    start = int(np.argmax(sums[width:] - sums[:-width])) if count > width else 0
    return slice(start, start + width)


@image
def draw_exposure(exposure: Exposure) -> Figure:
    """Draw residuals against the variable that exposes a finding, as points and as means."""
    figure = blank(7.0, 2.8)
    axes = figure.subplots()
    factor, unit = readable(exposure.channel_unit)
    across, name = readable(exposure.unit)
    values = across * exposure.values
    size, alpha = (26.0, 0.8) if len(values) < FEW else (7.0, 0.3)
    axes.axhline(0.0, color="#888888", linewidth=0.6)
    for label, colour, residual in (
        ("without it", BEFORE, exposure.before),
        ("with it", AFTER, exposure.after),
    ):
        shown = factor * residual
        axes.scatter(values, shown, s=size, alpha=alpha, color=colour, linewidths=0, label=label)
        middles, means = binned(values, shown)
        axes.plot(middles, means, color=colour, linewidth=2.0)
    axes.margins(0.05, 0.1)
    axes.set_xlabel(f"{exposure.variable} [{name}]" if name else exposure.variable)
    axes.set_ylabel(f"residual [{unit}]")
    for handle in axes.legend(frameon=False, loc="best", markerscale=5.0 / np.sqrt(size)).legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
    axes.grid(visible=True, alpha=0.3, linewidth=0.5)
    return figure


def binned(values: Floats, residual: Floats) -> tuple[Floats, Floats]:
    """Average a residual in bins of a variable; bins with few points are left out."""
    good = np.isfinite(values) & np.isfinite(residual)
    if not good.any() or np.ptp(values[good]) == 0.0:
        return np.zeros(0), np.zeros(0)
    edges = np.linspace(values[good].min(), values[good].max(), BINS + 1)
    which = np.clip(np.digitize(values[good], edges) - 1, 0, BINS - 1)
    counts = np.bincount(which, minlength=BINS)
    sums = np.bincount(which, weights=residual[good], minlength=BINS)
    kept = counts >= LEAST_IN_BIN
    middles = 0.5 * (edges[1:] + edges[:-1])
    return middles[kept], sums[kept] / counts[kept]


@image
def draw_arm(specimen: Specimen, shares: Shares) -> Figure:
    """Draw the hanging arm from the side; the redder a place, the larger its share of the mismatch.

    Args:
        specimen: Its lay-out.
        shares: Share of the mismatch that each place alone removes, 0 to 1.
    """
    figure = blank(3.2, 4.6)
    axes = figure.subplots()
    end = max([s.to_m for s in specimen.segments] + [s.to_m for s in specimen.sections])
    thick = 0.09 * end
    _box(axes, (-3.0 * thick, -0.05 * end), (6.0 * thick, 0.03 * end), shares.get(("base", "base"), 0.0))
    axes.text(0.0, -0.07 * end, f"mount {_percent(shares.get(('base', 'base'), 0.0))}", ha="center")
    for segment in specimen.segments:
        share = shares.get(("segment", segment.name), 0.0)
        length = segment.to_m - segment.from_m
        _box(axes, (-thick, segment.from_m), (2.0 * thick, length), share)
        middle = segment.from_m + 0.5 * length
        axes.text(-1.4 * thick, middle, f"{segment.name} {_percent(share)}", ha="right", va="center")
        own = [chamber.index for chamber in specimen.chambers if chamber.segment == segment.name]
        for number, index in enumerate(own):
            part = shares.get(("chamber", str(index)), 0.0)
            wide = 2.0 * thick / len(own)
            corner = (-thick + (number + 0.1) * wide, segment.from_m + 0.28 * length)
            _box(axes, corner, (0.8 * wide, 0.44 * length), part)
            axes.text(-thick + (number + 0.5) * wide, middle, str(index), ha="center", va="center")
    for section in specimen.sections:
        length = max(section.to_m - section.from_m, 0.015 * end)
        _box(axes, (-1.2 * thick, section.from_m), (2.4 * thick, length), 0.0)
        axes.text(1.5 * thick, section.from_m + 0.5 * length, section.name, ha="left", va="center")
    sensors = sorted((share, name) for (kind, name), share in shares.items() if kind == "sensor")[::-1]
    for number, (share, name) in enumerate(sensors[:4]):
        y = (1.06 + 0.05 * number) * end
        _box(axes, (-4.0 * thick, y - 0.015 * end), (0.4 * thick, 0.03 * end), share)
        axes.text(-3.4 * thick, y, f"sensor {name} {_percent(share)}", va="center")
    axes.set(xlim=(-5.0 * thick, 5.0 * thick), ylim=(1.27 * end, -0.12 * end))
    axes.axis("off")
    return figure


def colour(share: float) -> tuple[float, float, float]:
    """Return the colour of a share, grey for none and red for all, as red, green and blue from 0 to 1."""
    cold, hot = np.array([226.0, 232.0, 240.0]), np.array([200.0, 30.0, 30.0])
    red, green, blue = ((cold + np.clip(share, 0.0, 1.0) * (hot - cold)) / 255.0).tolist()
    return red, green, blue


def _box(axes: Axes, corner: tuple[float, float], size: tuple[float, float], share: float) -> None:
    axes.add_patch(Rectangle(corner, *size, facecolor=colour(share), edgecolor="#555555", linewidth=0.8))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.005 else ""


def _shade(axes: Axes, time: Floats, shaded: Flags) -> None:
    """Shade stretches of time, each sample with half a step on both sides."""
    half = 0.5 * float(np.median(np.diff(time))) if len(time) > 1 else 0.5
    for first, last in runs(shaded):
        axes.axvspan(time[first] - half, time[last - 1] + half, color=SHADE, linewidth=0, zorder=0)

"""Charts as inline SVG: curves over time, residuals against a variable, bars. Nothing is fetched."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

MEASURED, BEFORE, AFTER, SHADE = "#222222", "#d95f02", "#1b7f79", "#e8edf3"
WIDTH, HEIGHT = 760, 190
LEFT, RIGHT, TOP, BOTTOM = 62, 12, 12, 34
POINTS = 600
CLOUD = 1200
FEW = 60
"""Points below which each is drawn so that it is seen by itself."""
TICKS = 5
SCALES = {"rad": (57.29577951308232, "degrees"), "m": (1e3, "mm"), "Pa": (1e-3, "kPa")}


def in_words(unit: str) -> tuple[float, str]:
    """Give the factor and the name of the unit in which people read a quantity."""
    return SCALES.get(unit, (1.0, "" if unit == "1" else unit))


@dataclass(frozen=True)
class Curve:
    """One curve or cloud of points.

    Args:
        name: In the legend.
        colour: Of its line.
        values: Shape (samples,); NaN leaves a gap.
    """

    name: str
    colour: str
    values: Floats


@dataclass(frozen=True)
class Frame:
    """Axes of a chart: the ranges of both and their titles."""

    low: tuple[float, float]
    high: tuple[float, float]
    across: str
    upward: str

    def x(self, values: Floats) -> Floats:
        """Place values along the horizontal axis [px]."""
        span = self.high[0] - self.low[0] or 1.0
        return LEFT + (values - self.low[0]) / span * (WIDTH - LEFT - RIGHT)

    def y(self, values: Floats) -> Floats:
        """Place values along the vertical axis [px]."""
        span = self.high[1] - self.low[1] or 1.0
        return HEIGHT - BOTTOM - (values - self.low[1]) / span * (HEIGHT - TOP - BOTTOM)


def over_time(time: Floats, curves: Sequence[Curve], unit: str, shaded: Flags | None = None) -> str:
    """Draw curves over time, held-out stretches shaded."""
    factor, name = in_words(unit)
    scaled = [Curve(c.name, c.colour, factor * c.values) for c in curves]
    frame = _frame(time, scaled, "time [s]", name)
    parts = [] if shaded is None else _bands(frame, time, shaded)
    parts += [_line(frame, time, curve) for curve in scaled]
    return _svg(parts + _axes(frame), _legend(scaled))


def against(values: Floats, curves: Sequence[Curve], across: str, unit: str) -> str:
    """Draw residuals as clouds against a variable, with their running means."""
    factor, name = in_words(unit)
    scaled = [Curve(c.name, c.colour, factor * c.values) for c in curves]
    frame = _frame(values, scaled, across, f"residual [{name}]")
    parts = []
    for curve in scaled:
        parts.append(_cloud(frame, values, curve))
        parts.append(_mean(frame, values, curve))
    return _svg(parts + _axes(frame), _legend(scaled))


def bars(rows: Sequence[tuple[str, float]], title: str) -> str:
    """Draw named amounts as horizontal bars."""
    height, widest = 20, max((abs(value) for _, value in rows), default=1.0) or 1.0
    parts = []
    for number, (name, value) in enumerate(rows):
        top = number * height
        length = 380.0 * abs(value) / widest
        parts.append(
            f'<text x="250" y="{top + 14}" text-anchor="end" font-size="12">{escape(name)}</text>'
            f'<rect x="258" y="{top + 4}" width="{length:.1f}" height="12" fill="{BEFORE}" opacity="0.75"/>'
            f'<text x="{264 + length:.1f}" y="{top + 14}" font-size="11">{value:.3g}</text>'
        )
    label = f'role="img" aria-label="{escape(title)}"'
    size = f'viewBox="0 0 {WIDTH} {height * len(rows) + 4}"'
    return f"<svg {size} {label}>{''.join(parts)}</svg>"


def _frame(across: Floats, curves: Sequence[Curve], title: str, upward: str) -> Frame:
    every = np.concatenate([curve.values for curve in curves])
    every = every[np.isfinite(every)]
    x = across[np.isfinite(across)]
    low, high = np.percentile(every, [0.2, 99.8]) if len(every) else (0.0, 1.0)
    margin = 0.06 * (high - low) or 1.0
    left, right = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
    if left == right:
        left, right = left - 0.5, right + 0.5
    return Frame((left, float(low - margin)), (right, float(high + margin)), title, upward)


def _thin(count: int, wanted: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, min(count, wanted)).astype(np.int64))


def _line(frame: Frame, time: Floats, curve: Curve) -> str:
    """Draw a curve, broken where it is NaN."""
    kept = _thin(len(time), POINTS)
    x, y = frame.x(time[kept]), frame.y(curve.values[kept])
    words, pen = [], "M"
    for a, b in zip(x, np.clip(y, 0, HEIGHT), strict=True):
        if not np.isfinite(b):
            pen = "M"
            continue
        words.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L"
    return f'<path d="{"".join(words)}" fill="none" stroke="{curve.colour}" stroke-width="1.2"/>'


def _cloud(frame: Frame, values: Floats, curve: Curve) -> str:
    kept = _thin(len(values), CLOUD)
    x, y = frame.x(values[kept]), frame.y(curve.values[kept])
    good = np.isfinite(x) & np.isfinite(y)
    dots = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[good], np.clip(y[good], 0, HEIGHT), strict=True))
    few = good.sum() < FEW
    style = f'stroke-linecap="round" stroke-width="{5.0 if few else 2.4}" opacity="{0.8 if few else 0.3}"'
    return f'<path d="{dots}" fill="none" stroke="{curve.colour}" {style}/>'


def _mean(frame: Frame, values: Floats, curve: Curve, bins: int = 14) -> str:
    """Draw the mean residual in bins of the variable."""
    edges = np.linspace(frame.low[0], frame.high[0], bins + 1)
    which = np.clip(np.digitize(values, edges) - 1, 0, bins - 1)
    good = np.isfinite(curve.values) & np.isfinite(values)
    points = []
    for b in range(bins):
        inside = good & (which == b)
        if inside.sum() >= 3:
            middle = 0.5 * (edges[b] + edges[b + 1])
            mean = np.array([np.mean(curve.values[inside])])
            points.append(f"{frame.x(np.array([middle]))[0]:.1f},{frame.y(mean)[0]:.1f}")
    return f'<polyline points="{" ".join(points)}" fill="none" stroke="{curve.colour}" stroke-width="2.2"/>'


def _bands(frame: Frame, time: Floats, shaded: Flags) -> list[str]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], shaded, [False]]).astype(int))).reshape(-1, 2)
    x = frame.x(time)
    return [
        f'<rect x="{x[a]:.1f}" y="{TOP}" width="{max(x[b - 1] - x[a], 0.5):.1f}"'
        f' height="{HEIGHT - TOP - BOTTOM}" fill="{SHADE}"/>'
        for a, b in edges
    ]


def _axes(frame: Frame) -> list[str]:
    parts = [
        f'<path d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}" fill="none" stroke="#888"/>',
        f'<text x="{(LEFT + WIDTH) / 2:.0f}" y="{HEIGHT - 4}" class="axis">{escape(frame.across)}</text>',
        f'<text transform="translate(12 {(HEIGHT - BOTTOM) / 2:.0f}) rotate(-90)" class="axis">'
        f"{escape(frame.upward)}</text>",
    ]
    for value in _ticks(frame.low[0], frame.high[0]):
        x = frame.x(np.array([value]))[0]
        parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 14}" class="tick">{value:g}</text>')
    for value in _ticks(frame.low[1], frame.high[1]):
        y = frame.y(np.array([value]))[0]
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="#ddd" stroke-width="0.6"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" class="tick" text-anchor="end">{value:g}</text>')
    return parts


def _ticks(low: float, high: float) -> list[float]:
    """Choose round numbers within a range."""
    span = high - low
    if not span > 0.0:
        return [low]
    size = 10.0 ** np.floor(np.log10(span / TICKS))
    step = next(size * m for m in (1.0, 2.0, 5.0, 10.0) if span / (size * m) <= TICKS)
    first = int(np.ceil(low / step))
    return [float(f"{k * step:.6g}") for k in range(first, int(np.floor(high / step)) + 1)]


def _svg(parts: Sequence[str], legend: str) -> str:
    chart = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{"".join(parts)}</svg>'
    return f'<figure>{chart}<figcaption class="legend">{legend}</figcaption></figure>'


def _legend(curves: Sequence[Curve]) -> str:
    return " ".join(
        f'<span><i style="background:{curve.colour}"></i>{escape(curve.name)}</span>' for curve in curves
    )

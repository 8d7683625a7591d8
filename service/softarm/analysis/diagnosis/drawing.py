"""The arm, coloured by where the mismatch sits."""

from collections.abc import Mapping
from html import escape

from softarm.estimator.diagnosis.result import CellKind
from softarm.estimator.specimen import Specimen

WIDTH, HEIGHT = 300, 430
TOP, LENGTH, MIDDLE = 40.0, 330.0, 150.0
THICK = 26.0
COLD, HOT = (226, 232, 240), (200, 30, 30)

Shares = Mapping[tuple[CellKind, str], float]


def draw_arm(specimen: Specimen, shares: Shares) -> str:
    """Draw the hanging arm from the side as inline SVG; the redder, the more of the mismatch sits there.

    Args:
        specimen: Its lay-out.
        shares: Share of the mismatch that each place alone removes, 0 to 1.
    """
    end = max([s.to_m for s in specimen.segments] + [s.to_m for s in specimen.sections])
    parts = [
        _base(shares),
        *(_body(specimen, s.name, _at(s.from_m, end), _at(s.to_m, end), shares) for s in specimen.segments),
        *(_section(s.name, _at(s.from_m, end), _at(s.to_m, end), shares) for s in specimen.sections),
        _sensors(shares),
    ]
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" class="arm" role="img">{"".join(parts)}</svg>'


def colour(share: float) -> str:
    """Give the colour of a share, grey for none and red for all."""
    share = min(max(share, 0.0), 1.0)
    mixed = (round(c + share * (h - c)) for c, h in zip(COLD, HOT, strict=True))
    return "rgb({},{},{})".format(*mixed)


def _at(height: float, end: float) -> float:
    return TOP + LENGTH * height / end


def _title(name: str, share: float) -> str:
    return f"<title>{escape(name)}: removes {100.0 * share:.0f} % of the mismatch</title>"


def _base(shares: Shares) -> str:
    share = shares.get(("base", "base"), 0.0)
    box = f'x="{MIDDLE - 70}" y="{TOP - 14}" width="140" height="12"'
    return (
        f'<g>{_title("mount", share)}<rect {box} fill="{colour(share)}" stroke="#555"/>'
        f'<text x="{MIDDLE}" y="{TOP - 20}" text-anchor="middle" font-size="12">mount</text></g>'
    )


def _body(specimen: Specimen, name: str, top: float, low: float, shares: Shares) -> str:
    """Draw a segment and, side by side in it, its chambers."""
    share = shares.get(("segment", name), 0.0)
    chambers = [chamber.index for chamber in specimen.chambers if chamber.segment == name]
    box = f'x="{MIDDLE - THICK}" y="{top:.1f}" width="{2 * THICK}" height="{low - top:.1f}"'
    text = f'x="{MIDDLE - THICK - 8}" y="{(top + low) / 2:.1f}" text-anchor="end" font-size="12"'
    parts = [
        f'<g>{_title(f"segment {name}", share)}<rect {box} rx="6" fill="{colour(share)}" stroke="#555"/>'
        f"<text {text}>{escape(name)} {_percent(share)}</text></g>"
    ]
    width = 2.0 * THICK / max(len(chambers), 1) - 3.0
    for place, index in enumerate(chambers):
        part = shares.get(("chamber", str(index)), 0.0)
        x = MIDDLE - THICK + 1.5 + place * (width + 3.0)
        inset = 0.28 * (low - top)
        slot = f'x="{x:.1f}" y="{top + inset:.1f}" width="{width:.1f}" height="{low - top - 2 * inset:.1f}"'
        parts.append(
            f'<g>{_title(f"chamber {index}", part)}<rect {slot} rx="4" fill="{colour(part)}" stroke="#999"/>'
            f'<text x="{x + width / 2:.1f}" y="{(top + low) / 2:.1f}" text-anchor="middle" font-size="11">'
            f"{index}</text></g>"
        )
    return "".join(parts)


def _section(name: str, top: float, low: float, shares: Shares) -> str:
    share = shares.get(("section", name), 0.0)
    box = (
        f'x="{MIDDLE - THICK - 6}" y="{top:.1f}" width="{2 * THICK + 12}" height="{max(low - top, 6.0):.1f}"'
    )
    text = f'x="{MIDDLE + THICK + 12}" y="{top + 9:.1f}" font-size="12"'
    return (
        f'<g>{_title(f"section {name}", share)}<rect {box} rx="2" fill="{colour(share)}" stroke="#333"/>'
        f"<text {text}>{escape(name)} {_percent(share)}</text></g>"
    )


def _sensors(shares: Shares) -> str:
    """List the sensors below the arm."""
    named = sorted((name, share) for (kind, name), share in shares.items() if kind == "sensor")
    parts = []
    for number, (name, share) in enumerate(named[:4]):
        y = TOP + LENGTH + 18 + 14 * number
        parts.append(
            f'<g>{_title(f"sensor {name}", share)}<rect x="40" y="{y - 9}" width="12" height="10"'
            f' fill="{colour(share)}" stroke="#555"/><text x="58" y="{y}" font-size="11">'
            f"sensor {escape(name)} {_percent(share)}</text></g>"
        )
    return "".join(parts)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.005 else ""

"""``report.html``: a diagnosis for people, in one file that fetches nothing."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from softarm.analysis.diagnosis.charts import (
    AFTER,
    BEFORE,
    MEASURED,
    Curve,
    against,
    bars,
    in_words,
    over_time,
)
from softarm.analysis.diagnosis.drawing import draw_arm
from softarm.estimator.diagnosis.result import Diagnosis, Exposure, Finding, Quantity, Trace
from softarm.estimator.diagnosis.screen import DRAWS
from softarm.estimator.effects.effect import describe
from softarm.estimator.specimen import Specimen
from softarm.recordings.files import whole_files

Floats = NDArray[np.float64]

FILE = "report.html"
SHOWN = 6
CELLS = 10
"""Traces, and rows of the map, that are shown."""

VERDICTS = {
    "consistent": "The model agrees with the recordings: nothing beyond noise and calibration is missing.",
    "explained": "The model was missing physics; what is named below explains it down to the noise.",
    "partly_explained": "The model is missing physics; what is named below explains a part of the mismatch.",
    "unexplained": "The model is missing physics that none of the known effects accounts for.",
}

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:860px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin-bottom:.2em} h2{font-size:1.2em;border-bottom:1px solid #ccc;margin-top:2em}
h3{font-size:1.02em;margin-bottom:.2em} table{border-collapse:collapse;font-size:13px;margin:.6em 0}
td,th{padding:2px 10px;border-bottom:1px solid #e3e3e3;text-align:right}
td:first-child,th:first-child{text-align:left}
figure{margin:.4em 0} svg{width:100%;height:auto;font-family:inherit} svg.arm{max-width:300px;float:right}
.axis{font-size:12px;text-anchor:middle;fill:#444} .tick{font-size:10px;fill:#555;text-anchor:middle}
.legend{font-size:12px} .legend i{display:inline-block;width:12px;height:4px;margin:0 4px 3px 10px}
.verdict{font-size:1.1em;border-left:5px solid #1b7f79;padding:.3em .9em;background:#f2f6f6}
.numbers b{font-size:1.5em;display:block} .numbers{display:flex;gap:2.2em;margin:1em 0}
.note{color:#555;font-size:13px} code{background:#f1f1f1;padding:0 3px} section{clear:both}
"""


def write_html(diagnosis: Diagnosis, specimen: Specimen, folder: Path) -> Path:
    """Write ``report.html`` to a folder; an earlier one is replaced.

    Args:
        diagnosis: What to tell.
        specimen: The arm, for its drawing.
        folder: Made when absent.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    with whole_files(path) as (draft,):
        draft.write_text(page(diagnosis, specimen), encoding="utf-8")
    return path


def page(diagnosis: Diagnosis, specimen: Specimen) -> str:
    """Give the text of the page."""
    title = f"Diagnosis of {diagnosis.specimen}"
    body = "".join(
        (
            _head(diagnosis, title),
            _findings(diagnosis),
            _map(diagnosis, specimen),
            _heldout(diagnosis),
            _channels(diagnosis),
            _left(diagnosis),
            _data(diagnosis),
        )
    )
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def _head(diagnosis: Diagnosis, title: str) -> str:
    names = ", ".join(diagnosis.recordings)
    nominal = f" Known state: {', '.join(diagnosis.nominal)}." if diagnosis.nominal else ""
    heldout = diagnosis.heldout
    low, high = (100.0 * gain for gain in heldout.gain_ci95)
    gain = f"{low:.0f} to {high:.0f} %"
    return (
        f"<h1>{escape(title)}</h1><p class=note>Recordings: {escape(names)}.{escape(nominal)}</p>"
        f'<p class="verdict">{VERDICTS[diagnosis.verdict]}</p><div class="numbers">'
        f"<span><b>{heldout.before:.2f}</b>mismatch before, in units of noise</span>"
        f"<span><b>{heldout.after:.2f}</b>after, on data no fit has seen</span>"
        f"<span><b>{gain}</b>gain, 95 % interval</span></div>"
    )


def _findings(diagnosis: Diagnosis) -> str:
    if not diagnosis.findings:
        return "<section><h2>What was left out</h2><p>No effect is named.</p></section>"
    parts = [_finding(number, finding) for number, finding in enumerate(diagnosis.findings, start=1)]
    return f"<section><h2>What was left out</h2>{''.join(parts)}</section>"


def _finding(number: int, finding: Finding) -> str:
    evidence = finding.evidence
    low, high = (100.0 * gain for gain in evidence.heldout_gain_ci95)
    title = f"{number}. {finding.effect.replace('_', ' ')}, {describe(finding.where)}"
    if finding.effect == "unknown":
        return f"<h3>{escape(title)}</h3><p>{escape(finding.statement)}</p>"
    told = (
        f"Gain on held-out data: {low:.0f} to {high:.0f} %, from {evidence.heldout_before:.2f} to "
        f"{evidence.heldout_after:.2f} times the noise. The evidence is {evidence.delta_bic:.0f} in BIC"
    )
    chance = (
        f"; a search where nothing is missing finds as much with a chance of {_chance(evidence.search_p)}"
    )
    told += "." if np.isnan(evidence.search_p) else f"{chance}."
    rows = [[name, _quantity(q)] for name, q in finding.parameters.items()]
    shown = _exposure(finding.exposure) if finding.exposure is not None else ""
    return (
        f"<h3>{escape(title)}</h3><p>{escape(finding.statement)}</p>"
        f"<p>{told}</p>"
        f"{_table(['parameter', 'value and deviation'], rows)}{shown}{_rivals(finding)}"
    )


def _exposure(exposure: Exposure) -> str:
    factor, name = in_words(exposure.unit)
    curves = [Curve("without it", BEFORE, exposure.before), Curve("with it", AFTER, exposure.after)]
    across = f"{exposure.variable} [{name}]" if name else exposure.variable
    told = f"<p class=note>Residual of {escape(exposure.channel)} against {escape(exposure.variable)}.</p>"
    return told + against(factor * exposure.values, curves, across, exposure.channel_unit)


def _rivals(finding: Finding) -> str:
    parts = []
    if finding.confusable_with:
        told = "".join(
            f"<li>{escape(r.effect.replace('_', ' '))} ({escape(describe(r.where))}): to decide, "
            f"{escape(r.manoeuvre)}</li>"
            for r in finding.confusable_with
        )
        parts.append(
            f"<p>These recordings cannot tell it from:</p><ul>{told}</ul>"
            "<p class=note><code>softarm excite --arm ID --report FOLDER</code> runs what decides.</p>"
        )
    if finding.rejected:
        rows = [(f"{r.effect.replace('_', ' ')}, {describe(r.where)}", r.delta_bic) for r in finding.rejected]
        parts.append("<p>Alternatives, and by how much they lost (BIC):</p>")
        parts.append(bars(rows[:8], "alternatives and by how much they lost"))
    return "".join(parts)


def _map(diagnosis: Diagnosis, specimen: Specimen) -> str:
    rows = [
        [
            f"{cell.kind} {cell.name}" if cell.kind != "base" else "base",
            cell.axis,
            cell.regime,
            _amount(cell.amplitude, cell.unit),
            f"{100.0 * cell.share:.0f} %",
            _chance(cell.p_value),
        ]
        for cell in diagnosis.map.cells[:CELLS]
    ]
    heads = ["place", "axis", "varies with", "equivalent load", "removes", "chance"]
    drawing = draw_arm(specimen, diagnosis.map.by_place())
    told = (
        "The redder a place, the more of the mismatch a load, a pressure or an offset there alone would "
        "remove. Chance: of so much anywhere, were nothing missing."
    )
    return f"<section><h2>Where the mismatch sits</h2>{drawing}<p>{told}</p>{_table(heads, rows)}</section>"


def _heldout(diagnosis: Diagnosis) -> str:
    chosen = sorted(diagnosis.traces, key=_improvement, reverse=True)[:SHOWN]
    how = diagnosis.heldout.how_split.rstrip(".")
    parts = [f"<p>{escape(how[:1].upper() + how[1:])}. Shaded: data that no fit and no choice has seen.</p>"]
    for trace in chosen:
        curves = [
            Curve("measured", MEASURED, trace.measured),
            Curve("model before", BEFORE, trace.before),
            Curve("model after", AFTER, trace.after),
        ]
        parts.append(f"<h3>{escape(trace.recording)}: {escape(trace.channel)}</h3>")
        parts.append(over_time(trace.time, curves, trace.unit, trace.heldout))
        gaps = [
            Curve("residual before", BEFORE, trace.measured - trace.before),
            Curve("residual after", AFTER, trace.measured - trace.after),
        ]
        parts.append(over_time(trace.time, gaps, trace.unit, trace.heldout))
    return f"<section><h2>Before and after</h2>{''.join(parts)}</section>"


def _improvement(trace: Trace) -> float:
    """Give the drop of the residual over its size before; what has no held-out data counts in full."""
    chosen = trace.heldout if trace.heldout.any() else np.ones(len(trace.time), dtype=bool)
    before, after = (
        _rms((trace.measured - trace.before)[chosen]),
        _rms((trace.measured - trace.after)[chosen]),
    )
    return (before - after) / before if before > 0.0 else 0.0


def _channels(diagnosis: Diagnosis) -> str:
    base = diagnosis.baseline
    rows = []
    for channel, rms in base.rms.items():
        unit = base.units.get(channel, "")
        after = [(t.measured - t.after)[t.heldout] for t in diagnosis.traces if t.channel == channel]
        left = _rms(np.concatenate(after)) if after else float("nan")
        rows.append(
            [
                channel,
                _amount(rms, unit),
                _amount(left, unit) if np.isfinite(left) else "-",
                _amount(base.noise_floor.get(channel, float("nan")), unit),
            ]
        )
    heads = ["channel", "rms before", "after, held out", "noise floor"]
    return f"<section><h2>Channels</h2>{_table(heads, rows)}</section>"


def _left(diagnosis: Diagnosis) -> str:
    left = diagnosis.unexplained
    place = describe(left.where)
    sentence = (
        f"With all findings the mismatch on held-out data is {left.normalised_rms:.2f} times the noise."
    )
    if left.when:
        sentence += f" Most of what is left sits in {place} and varies with {left.when}."
    missing = "".join(
        f"<li>{escape(one.effect.replace('_', ' '))}: {escape(one.missing)}</li>"
        for one in diagnosis.not_testable
    )
    untested = f"<p>These recordings could not have shown:</p><ul>{missing}</ul>" if missing else ""
    return f"<section><h2>What is left</h2><p>{escape(sentence)}</p>{untested}</section>"


def _data(diagnosis: Diagnosis) -> str:
    notes = "".join(f"<li>{escape(note)}</li>" for note in diagnosis.notes)
    listed = f"<ul>{notes}</ul>" if notes else ""
    took = f"<p class=note>Took {diagnosis.seconds:.0f} s.</p>"
    return f"<section><h2>The data and the way</h2>{listed}{took}</section>"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _amount(value: float, unit: str) -> str:
    factor, name = in_words(unit)
    return f"{factor * value:.3g} {name}".strip()


def _chance(p: float) -> str:
    """Write a chance; it was drawn some hundred times, so that none is nought."""
    return f"{p:.2g}" if p > 0.0 else f"below {1.0 / DRAWS:g}"


def _quantity(quantity: Quantity) -> str:
    factor, name = in_words(quantity.unit)
    return f"{factor * quantity.value:.4g} ± {factor * quantity.std:.2g} {name}".strip()


def _rms(values: Floats) -> float:
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else float("nan")

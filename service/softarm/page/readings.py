"""What the page shows of the messages, as HTML: every text of others is escaped."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath

import numpy as np

from softarm.page.text import plain
from softarm_client.messages import Estimate, HealthFinding, LoadEstimate, Mismatch, SectionPose, State
from softarm_client.modes import PRESSURISED, Mode

COLOURS = ("#e08a00", "#2ca02c", "#9467bd", "#17a2b8", "#8c564b", "#e377c2")
"""Of the forces, in the order of the sections: the arrow, the curve and the table's row."""
MODE_DESCRIPTIONS: Mapping[str, str] = {
    Mode.STARTING: "The service starts. The arm is vented.",
    Mode.IDLE: "The arm is vented and accepts no set-points.",
    Mode.ARMED: "The valves follow set-points. Pressures may change at any time.",
    Mode.TEACH: "The arm can be moved by hand.",
    Mode.HOLDING: "The arm holds a pose.",
    Mode.EXPERIMENT: "A program moves the arm.",
    Mode.FAULTED: "The arm was vented. Remedy the cause, then press Clear.",
    Mode.STOPPING: "The service ends. The arm is vented.",
}
WORST_FIRST = ("fault", "warning", "info")


def load_deviation(load: LoadEstimate) -> float:
    """Return the standard deviation of a force, root mean square over its estimated axes [N]."""
    variances = [row[axis] for axis, row in enumerate(load.covariance_n2)]
    known = [variance for variance in variances if variance is not None]
    return float(np.sqrt(max(sum(known) / len(known), 0.0))) if known else 0.0


def reading(name: str, content: str, title: str = "") -> str:
    """Return one block of the panel.

    Args:
        name: Its ``id``.
        content: HTML, escaped.
        title: HTML above it, escaped.
    """
    heading = f'<b class="title">{title}</b>' if title else ""
    return f'<div class="reading" id="{name}">{heading}{content}</div>'


def status(state: State) -> str:
    """Write the mode, its meaning and everything that is wrong, the worst first."""
    kind = "fault" if state.mode == Mode.FAULTED else "moving" if state.mode in PRESSURISED else ""
    cause = f'<div class="fault">{plain(state.fault_cause)}</div>' if state.fault_cause else ""
    wrong = sorted(state.findings, key=_rank)
    findings = "".join(f'<div class="{_rank_name(f)}">{_finding(f)}</div>' for f in wrong)
    words = f"{MODE_DESCRIPTIONS.get(state.mode, '')} {plain(state.teach_note or '')}"
    lease = f"Lease: {plain(state.lease.holder or 'free')}."
    return reading(
        "status",
        f'<div class="mode {kind}">{plain(state.mode)}</div>{words} {lease}{cause}'
        f'<div class="scrolls">{findings or "Nothing is wrong."}</div>',
    )


def lost_service(age_s: float, state: State | None) -> str:
    """Write for how long the service has not been heard."""
    since = "has sent nothing yet" if np.isinf(age_s) else f"has sent nothing for {age_s:.1f} s"
    last = "" if state is None else f" Its last mode was {plain(state.mode)}. Grey values are out of date."
    words = f'<div class="mode fault">NO SERVICE</div>The service {since}.{last} Only STOP can be pressed.'
    return reading("status", words)


def _finding(finding: HealthFinding) -> str:
    return f"{plain(finding.where)}: {plain(finding.message)}; {plain(finding.hint)}"


def _rank_name(finding: HealthFinding) -> str:
    return finding.severity if finding.severity in WORST_FIRST else "info"


def _rank(finding: HealthFinding) -> int:
    return WORST_FIRST.index(_rank_name(finding))


def forces(estimates: Sequence[LoadEstimate], sections: Sequence[SectionPose], note: str) -> str:
    """Write the force, the place and the tilt of each section.

    Args:
        estimates: The forces.
        sections: The poses.
        note: HTML below the table, escaped.
    """
    loads = {load.section: load for load in estimates}
    colours = dict(zip(loads, COLOURS * len(loads), strict=False))
    poses = {section.section: section for section in sections}
    rows = [
        f"<tr><td>{_swatch(colours.get(name))}{plain(name)}</td>{_force(loads.get(name))}{_pose(poses.get(name))}</tr>"
        for name in dict.fromkeys((*loads, *poses))
    ]
    head = "<tr><th>section</th><th>force [N]</th><th>x, y, z [mm]</th><th>tilt</th></tr>"
    return reading("forces", f"<table>{head}{''.join(rows)}</table>{note}", "External force")


def quality(estimate: Estimate) -> str:
    """Write where the contact is, and what the estimate rests on."""
    lost = f" Without {plain(', '.join(estimate.sensors_lost))}." if estimate.sensors_lost else ""
    timing = f"{plain(estimate.status)}, {1e3 * estimate.latency_s:.0f} ms old.{lost}"
    return f"{_contact(estimate)} {timing}"


def _swatch(colour: str | None) -> str:
    return f'<span class="dot" style="background:{colour or "transparent"}"></span>'


def _force(load: LoadEstimate | None) -> str:
    if load is None:
        return "<td></td>"
    return f"<td><b>{np.linalg.norm(load.force_n):.3f}</b> ± {load_deviation(load):.3f}</td>"


def _pose(pose: SectionPose | None) -> str:
    if pose is None:
        return "<td></td><td></td>"
    _, x, y, _ = pose.quaternion_wxyz
    tilt = np.degrees(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))
    place = ", ".join(f"{1e3 * coordinate:z.0f}" for coordinate in pose.position_m)
    return f"<td>{place}</td><td>{tilt:.1f}°</td>"


def _contact(estimate: Estimate) -> str:
    place = estimate.contact
    if place is None:
        return "Contact, place unknown;" if estimate.in_contact else "No contact;"
    return f"Contact {1e3 * place.height_m:.0f} ± {1e3 * place.height_std_m:.0f} mm from the base;"


def pressures(kinds: Mapping[str, Sequence[float | None]], limits_pa: Sequence[float]) -> str:
    """Write the pressures of each chamber as numbers and bars.

    Args:
        kinds: ``set-point``, ``applied``, ``measured``, or some of them: gauge pressures [Pa].
        limits_pa: Pressure at the right end of each chamber's bars [Pa].
    """
    rows = []
    for k, (limit_pa, *values) in enumerate(zip(limits_pa, *kinds.values(), strict=False)):
        bars, numbers = _bars(dict(zip(kinds, values, strict=True)), limit_pa), "".join(map(_kpa, values))
        rows.append(f'<tr><td>{k}</td><td><div class="bars">{bars}</div></td>{numbers}</tr>')
    names = "".join(f'<th><span class="legend {kind}">{kind}</span></th>' for kind in kinds)
    head = f"<tr><th></th><th></th>{names}</tr>"
    return reading("pressures", f"<table>{head}{''.join(rows)}</table>", "Pressure of each chamber [kPa]")


def _bars(values_pa: Mapping[str, float | None], limit_pa: float) -> str:
    return "".join(
        f'<i class="{kind}" style="top:{5 * row}px;width:{_percent(value, limit_pa):.1f}%"></i>'
        for row, (kind, value) in enumerate(values_pa.items())
    )


def _percent(value_pa: float | None, limit_pa: float) -> float:
    return 0.0 if value_pa is None else min(max(100.0 * value_pa / limit_pa, 0.0), 100.0)


def _kpa(pressure: float | None) -> str:
    return '<td class="fault">lost</td>' if pressure is None else f"<td>{pressure / 1e3:.1f}</td>"


def instruments(state: State) -> str:
    """Write the health of each instrument: its last valid reading, and whether a finding names it."""
    worst = {f.where: _rank_name(f) for f in sorted(state.findings, key=_rank, reverse=True)}
    names = dict.fromkeys((*state.ages_s, *worst))
    ages = {name: _age(state.ages_s[name]) if name in state.ages_s else "" for name in names}
    entries = "".join(_instrument(name, ages[name], worst.get(name, "")) for name in names)
    return reading("instruments", entries, "Instruments: age of the last reading")


def _age(age_s: float | None) -> str:
    if age_s is None:
        return "no reading"
    return f"{1e3 * age_s:.0f} ms" if age_s < 1.0 else f"{age_s:.0f} s"


def _instrument(name: str, age: str, severity: str) -> str:
    kind = severity or ("warning" if age == "no reading" else "")
    return f'<span class="instrument"><span class="dot {kind}"></span>{plain(name)} {age}</span>'


def model(mismatch: Mismatch) -> str:
    """Write whether model and measurements differ, where, and what to do."""
    square = mismatch.normalised_innovation_squared
    ratio = "" if square is None else f" (residual {np.sqrt(square):.1f}, expected 1)"
    if mismatch.consistent:
        words = f"They agree{ratio}."
    else:
        where = plain(", ".join(mismatch.where) or "an unknown place")
        name = f" Recorded in {_file(mismatch.recording)}." if mismatch.recording else ""
        words = f'<span class="warning">They differ at {where}{ratio}: {plain(mismatch.advice)}.{name}</span>'
    return reading("model", words, "Model and measurements")


def stress_scale(red_pa: float) -> str:
    """Write the colours of the surface, from no stress to that of its red end [Pa]."""
    scale = f'0 <span class="scale"></span> {red_pa / 1e3:.3g} kPa'
    return reading("stress", scale, "Colours of the arm: von Mises stress")


def recording(state: State) -> str:
    """Write the name of the recording that runs."""
    if state.recording is None:
        return reading("recording", "Nothing is recorded.")
    return reading("recording", f'<span class="recording">● {_file(state.recording)}</span>')


def _file(path: str) -> str:
    return plain(PurePath(path).name)

"""``softarm status``: what a running arm is doing."""

from pathlib import Path

import click
import numpy as np

from softarm.cli.output import json_option, show
from softarm.cli.running_arm import arm_options
from softarm.common.tables import Cell, Table
from softarm_client import Arm, Estimate, ServiceSilentError, State
from softarm_client.messages import HealthFinding, LoadEstimate
from softarm_client.modes import Mode

Row = dict[str, Cell]
NO_ESTIMATE = "No estimate is published; see the findings."
STARTING = "No estimate is published yet: the estimator is being built, which takes a minute or two at first."


@click.command()
@arm_options
@json_option
def command(arm: str, endpoint: str, zenoh_config: Path | None, as_json: bool) -> int:
    """Show mode, forces, poses, pressures and findings of a running arm; it moves nothing.

    Exit status: 0 whatever the mode, 1 when no service of this arm answers, 2 for wrong use.

    Example: softarm status --arm sopra
    """
    with Arm(arm, endpoint, "softarm status", zenoh_config=zenoh_config) as running:
        state = running.state()
        try:
            estimate = running.estimate()
        except ServiceSilentError:
            estimate = None
    show(*status_tables(arm, state, estimate), as_json=as_json)
    return 0


def status_tables(arm: str, state: State, estimate: Estimate | None) -> tuple[Table, ...]:
    """Lay out a state and an estimate.

    Args:
        arm: The arm's name.
        state: The newest state.
        estimate: The newest estimate, ``None`` where none is published.

    Returns:
        The arm, its sections with their forces, its chambers, its findings.
    """
    missing = STARTING if state.mode == Mode.STARTING else NO_ESTIMATE
    notes = (missing,) if estimate is None else ()
    return (
        Table(f"Arm {arm}", [_arm_row(state, estimate)], notes),
        Table("Sections", _section_rows(state, estimate)),
        Table("Chambers", _chamber_rows(state)),
        Table("Findings", [_finding_row(finding) for finding in state.findings]),
    )


def _arm_row(state: State, estimate: Estimate | None) -> Row:
    return {
        "mode": state.mode,
        "fault": state.fault_cause,
        "lease": state.lease.holder,
        "recording": state.recording,
        "source": state.stamp.source,
        "estimate": None if estimate is None else estimate.status,
        "latency_ms": None if estimate is None else 1e3 * estimate.latency_s,
    }


def _section_rows(state: State, estimate: Estimate | None) -> list[Row]:
    loads = {} if estimate is None else {load.section: load for load in estimate.loads}
    rows: list[Row] = []
    for pose in state.sections:
        row: Row = {"section": pose.section}
        row |= {
            f"{axis}_mm": round(1e3 * value, 3) for axis, value in zip("xyz", pose.position_m, strict=True)
        }
        rows.append(row | _force_cells(loads.get(pose.section)))
    return rows


def _force_cells(load: LoadEstimate | None) -> Row:
    """Return force and standard deviation along each axis; nothing along those that are not estimated."""
    row: Row = {}
    for k, axis in enumerate("xyz"):
        variance = None if load is None else load.covariance_n2[k][k]
        known = load is not None and variance is not None
        row[f"force_{axis}_n"] = load.force_n[k] if load is not None and known else None
        row[f"std_{axis}_n"] = None if variance is None else float(np.sqrt(variance))
    return row


def _chamber_rows(state: State) -> list[Row]:
    pressures = zip(state.asked_pa, state.applied_pa, state.measured_pa, strict=True)
    return [
        {
            "chamber": chamber,
            "setpoint_kpa": 1e-3 * setpoint,
            "applied_kpa": 1e-3 * applied,
            "measured_kpa": None if measured is None else 1e-3 * measured,
        }
        for chamber, (setpoint, applied, measured) in enumerate(pressures)
    ]


def _finding_row(finding: HealthFinding) -> Row:
    return {
        "severity": finding.severity,
        "where": finding.where,
        "finding": finding.message,
        "what_to_do": finding.hint,
    }

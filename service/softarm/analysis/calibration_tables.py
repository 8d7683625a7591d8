"""A calibration, and the check of an old one, arranged in tables."""

from collections.abc import Sequence

from softarm.common.tables import Table
from softarm.estimator.calibration import Calibrated, Drift
from softarm.estimator.counted import counted

DEGREES = 57.29577951308232


def drift_table(drifts: Sequence[Drift]) -> Table:
    """List for each quantity whether it scatters more than the calibration left it."""
    stale = [drift.quantity for drift in drifts if drift.stale]
    verdict = (
        f"Stale: {', '.join(stale)}; record each chamber alone, random poses and pulls, and calibrate anew."
        if stale
        else "The calibration is still valid."
    )
    return Table(
        "Scatter about the calibrated model",
        [
            {
                "quantity": drift.quantity,
                "unit": "m" if drift.quantity.endswith("position") else "rad",
                "now": drift.scatter,
                "calibrated": drift.calibrated,
                "ratio": drift.ratio,
                "stale": drift.stale,
            }
            for drift in drifts
        ],
        (verdict,),
    )


def calibration_tables(outcome: Calibrated) -> tuple[Table, ...]:
    """Arrange a calibration in tables: what was found, how well it predicts, what is missing."""
    missing = tuple(
        f"{entry.unknown.name}: {entry.verdict}; {entry.manoeuvre}"
        for entry in outcome.identified
        if entry.verdict != "determined"
    )
    lags = ", ".join("unknown" if lag is None else f"{lag * 1e3:.0f} ms" for lag in outcome.lags)
    unknowns: list[dict[str, str | int | float | bool | None]] = [
        {
            "unknown": entry.unknown.name,
            "value": entry.value,
            "std": entry.std,
            "unit": entry.unknown.unit,
            "verdict": entry.verdict,
            "std_over_known_before": entry.share,
        }
        for entry in outcome.identified
    ]
    handed = ", ".join(
        f"{name} {'left' if mirrored else 'right'}-handed" for name, mirrored in outcome.mirrored.items()
    )
    notes = (
        "; ".join(
            [
                f"{counted(outcome.fitted, 'unknown')} fitted to {counted(outcome.nodes, 'sample')}",
                outcome.status,
                *(
                    [f"motion lags the pressures by {lags}"]
                    if any(lag is not None for lag in outcome.lags)
                    else []
                ),
                *([f"axes of bends: {handed}"] if handed else []),
            ]
        )
        + ".",
        "A modulus is the logarithm of the factor on the specimen's.",
    )
    return (
        Table("Calibration", unknowns, (*notes, *missing)),
        Table(
            "Prediction error, rms",
            [_error_row(outcome, name) for name in outcome.check.training],
            (
                f"Held out: alternate blocks, left out of the fit. Line: ordinary linear regression of the "
                f"readings on the pressures, {outcome.check.line_parameters} numbers fitted on these blocks."
                if outcome.check.line
                else "Held out: alternate blocks or recordings, left out of the fit.",
            ),
        ),
    )


def _error_row(outcome: Calibrated, name: str) -> dict[str, str | float | None]:
    check = outcome.check
    sensor, _, component = name.rpartition(".")
    scale, unit = (1e3, "mm") if sensor.startswith("marker") else (DEGREES, "degrees")
    if sensor.startswith("frame"):
        scale, unit = (1e3, "mm") if int(component) < 3 else (DEGREES, "degrees")
    row: dict[str, str | float | None] = {"sensor": sensor, "component": component, "unit": unit}
    for heading, values in (
        ("old_calibration", check.before),
        ("training", check.training),
        ("held_out", check.held_out),
        ("line_held_out", check.line),
    ):
        row[heading] = values[name] * scale if name in values else None
    return row

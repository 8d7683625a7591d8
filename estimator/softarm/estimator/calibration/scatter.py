"""How readings scatter about a calibrated model, apart for the conditions in which it errs unlike."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.arrange import CalibrationRun
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.outcome import by_quantity
from softarm.estimator.specimen import Specimen

VENTED = 1.5e3  # Pa
VENTED_PULLS = ", vented pulls"
PRESSURISED_PULLS = ", pressurised pulls"


def rms(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> dict[str, float]:
    """Return the root mean square of the innovations by component of each sensor, over all runs."""
    squares: dict[str, list[Floats]] = {}
    for evaluation, own in zip(evaluations, nodes, strict=True):
        for name, rows in own.run.suite.slices.items():
            for number, column in enumerate(evaluation.innovation[:, rows].T):
                squares.setdefault(f"{name}.{number}", []).append(column[np.isfinite(column)] ** 2)
    joined = {name: np.concatenate(parts) for name, parts in squares.items()}
    return {name: float(np.sqrt(values.mean())) for name, values in joined.items() if len(values)}


def scatter_by_condition(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> dict[str, float]:
    """Return the scatter of each sensor by quantity: without known forces, and by name while a gauge pulls.

    An arm that hangs vented, drawn by a gauge, stays near rest and scatters less than one under pressure.

    Args:
        evaluations: What was predicted, per run.
        nodes: The nodes it was predicted for.
    """
    conditions = {
        "": [np.full(len(own.time), not own.run.pulled) for own in nodes],
        VENTED_PULLS: [own.run.pulled & vented(own.pressures) for own in nodes],
        PRESSURISED_PULLS: [own.run.pulled & ~vented(own.pressures) for own in nodes],
    }
    found: dict[str, float] = {}
    for suffix, flags in conditions.items():
        pairs = [
            (evaluation.keep(chosen), own.keep(chosen))
            for evaluation, own, chosen in zip(evaluations, nodes, flags, strict=True)
            if chosen.any()
        ]
        if pairs:
            parts = by_quantity(rms([pair[0] for pair in pairs], [pair[1] for pair in pairs]))
            found |= {f"{name}{suffix}": value for name, value in parts.items()}
        elif not suffix:
            found = by_quantity(rms(evaluations, nodes))
    return found


def scatter_in(specimen: Specimen, run: CalibrationRun) -> dict[str, float]:
    """Return the scatter that a specimen's calibration left in the condition of a run [m or rad].

    Args:
        specimen: The calibrated robot.
        run: What is to be estimated.
    """
    known = specimen.calibration.scatter
    plain = {name: value for name, value in known.items() if ", " not in name}
    if bool(vented(np.nan_to_num(run.pressures)).all()):
        suffix = VENTED_PULLS
    elif run.pulled:
        suffix = PRESSURISED_PULLS
    else:
        return plain
    return {name: known.get(f"{name}{suffix}", value) for name, value in plain.items()}


def vented(pressures: Floats) -> Flags:
    """Return which samples are vented, shape (samples,)."""
    return np.asarray((pressures < VENTED).all(axis=1))

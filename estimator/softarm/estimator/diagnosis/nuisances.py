"""Calibration of what a diagnosis takes for granted, on recordings in any mount."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.arrange import CalibrationRun
from softarm.estimator.calibration.fit import Scatter, fit
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import Layout, build_layout
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.start import best_scaled, solvable
from softarm.estimator.calibration.unknowns import (
    Alignment,
    Area,
    BaseMount,
    Gain,
    LinearGrowth,
    Modulus,
    SegmentCompliance,
    Unknown,
)
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Model, Stage, build_stage, thinned
from softarm.estimator.effects.excitation import mount_turned
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.specimen import Specimen

ITERATIONS = 6
SLOW_ITERATIONS = 3
NODES = 90
"""Samples of each session that a calibration looks at."""
COARSE = 25
FACTORS = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Factors on all moduli at which a fit may begin, and the samples of each session that decide which."""
STIFFER = (1.0, 2.0, 2.8, 4.0, 5.6)
"""The same of a slow model."""
LEAST_PRESSURE_SPREAD = 1.0e3
BEYOND = 3.0
"""Deviations of the prior from which a calibrated value is reported."""
KINDS = (Modulus, Area, Gain, LinearGrowth, Alignment, BaseMount, SegmentCompliance)
"""What may be calibrated before an effect is looked for; biases of pressures are effects of valves."""
SCATTER = Scatter({"m": 1.5e-3, "rad": 1.5e-2}, correlated=10.0)
"""Size [m, rad] of an error that a calibrated model is expected to leave, and number of samples alike: a
model's errors last for seconds. It is no estimate, since what is missing must not count as scatter."""


@dataclass(frozen=True)
class Nuisances:
    """A calibration.

    Args:
        layout: The unknowns.
        values: Their values, shape (unknowns,).
    """

    layout: Layout
    values: Floats

    @property
    def setting(self) -> Setting:
        """What the values stand for."""
        return self.layout.setting(self.values)

    def prior_rows(self) -> tuple[Floats, Floats]:
        """Return the prior as whitened residuals and their derivative; see ``Layout``."""
        return self.layout.prior_rows(self.values)

    @property
    def beyond_prior(self) -> tuple[str, ...]:
        """Sentences on values that leave what was known of them beforehand by ``BEYOND`` deviations."""
        away = (self.values - self.layout.means) / self.layout.spreads
        beyond = []
        for unknown, value, deviations in zip(self.layout.unknowns, self.values, away, strict=True):
            if abs(deviations) > BEYOND:
                size = f"{value:.4g} {unknown.unit} instead of {unknown.mean:.4g}"
                if isinstance(unknown, Modulus):
                    size = f"{np.exp(value - unknown.mean):.3g} times what the specimen says"
                beyond.append(
                    f"The calibration found {unknown.name} at {size}, {abs(deviations):.1f} standard "
                    "deviations off the prior: the specimen or the recording is not the one that was named."
                )
        return tuple(beyond)

    def stage(self, model: Model, session: Session) -> Stage:
        """Return a session on the calibrated model; see ``build_stage``."""
        return build_stage(model, session, self.setting)


def only_drawn(specimen: Specimen, sessions: Sequence[Session]) -> bool:
    """Return whether only an arm's drawing and the recordings in question determine its moduli."""
    before = set(specimen.calibration.recordings) - {session.name for session in sessions}
    return not before and not any(session.nominal for session in sessions)


def layout_of(model: Model, sessions: Sequence[Session]) -> Layout:
    """Choose the unknowns for what a set of sessions shows."""
    measurements = {m.name: m for session in sessions for m in session.suite.measurements}
    spread = np.max([np.ptp(session.pressures, axis=0) for session in sessions], axis=0, initial=0.0)
    moved = [k for k in range(len(spread)) if spread[k] > LEAST_PRESSURE_SPREAD]
    suite = SensorSuite(tuple(measurements.values()))
    # A known weight in several mounts determines the moduli: the chambers' mean gain may be anything.
    weighed = mount_turned(np.concatenate([session.gravity for session in sessions]))
    nominal = any(session.nominal for session in sessions)
    layout = build_layout(
        model.specimen,
        suite,
        ["measured"] * len(spread),
        moved,
        model.model.regions,
        weighed,
        model.sections,
        model.segments.names,
        drawn=only_drawn(model.specimen, sessions),
    )
    by_markers = any(
        m.registration is not None and m.registration.covariance.any() for m in measurements.values()
    )
    # Markers on the base register the laboratory; a recorded frame may be mounted askew.
    closed = {
        u.name
        for u in layout.unknowns
        if not isinstance(u, KINDS) or (by_markers and isinstance(u, BaseMount)) or not (nominal or _open(u))
    }
    return layout.without(closed)


def _open(unknown: Unknown) -> bool:
    """Return whether an unknown may be calibrated on the very recordings in question.

    Gains of chambers and biases of bends are then what is looked for, not what is taken for granted.
    """
    return not isinstance(unknown, Gain | LinearGrowth) and ".bias" not in unknown.name


def calibrate_sessions(model: Model, sessions: Sequence[Session]) -> Nuisances:
    """Fit moduli, gains, compliances and alignments to what sessions show outside their held-out parts.

    Args:
        model: The model.
        sessions: The sessions.
    """
    layout = layout_of(model, sessions)
    # A model that cannot twist or lengthen further keeps its compliances, which stay open to first order.
    fixed = set() if hasattr(model.model, "with_compliances") else {n.name for n in _compliances(layout)}
    inside = np.array([name not in fixed for name in layout.names], dtype=bool)
    fitted = [session.thin(~session.heldout) for session in sessions if not session.heldout.all()]
    segments = model.segments if inside[layout.of(SegmentCompliance)].any() else None
    forward = Forward(model.model, layout.without(fixed), _nodes(fitted, NODES), segments)
    few = replace(forward, nodes=_nodes(fitted, COARSE))
    start = forward.layout.means
    start = best_scaled(few, FACTORS, SCATTER) if model.fast else solvable(few, start, STIFFER)
    iterations = ITERATIONS if model.fast else SLOW_ITERATIONS
    values = layout.means
    values[inside] = fit(forward, start, iterations=iterations, scatter=SCATTER).values
    return Nuisances(layout, values)


def _compliances(layout: Layout) -> list[Unknown]:
    return [unknown for unknown in layout.unknowns if isinstance(unknown, SegmentCompliance)]


def _nodes(sessions: Sequence[Session], count: int) -> tuple[Nodes, ...]:
    return tuple(_nodes_of(thinned(session, count)) for session in sessions)


def _nodes_of(session: Session) -> Nodes:
    """Take the samples of a session as nodes of a calibration, all of one weight."""
    loads = session.wrenches.reshape(session.samples, -1)
    run = CalibrationRun(
        session.name,
        session.clock,
        session.pressures,
        ("measured",) * session.pressures.shape[1],
        session.suite,
        session.readings,
        loads,
        tuple(f"wrench_{k}" for k in range(loads.shape[1])),
        gravity=session.gravity[0],
    )
    weights = np.ones(session.samples)
    return Nodes(run, session.clock, session.pressures, session.readings, loads, weights, session.blocks)

"""Calibration of the nuisances of a diagnosis over recordings in any mount: Gauss-Newton with priors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.calibration.parameters import Layout, Parameter, Setting, build_layout
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Model, Stage, build_stage, thinned
from softarm.estimator.sensing import SensorSuite

Floats = NDArray[np.float64]

ITERATIONS = 6
SLOW_ITERATIONS = 3
NODES = 90
"""Samples of each session that a calibration looks at."""
TORSION_SPREAD = 0.5
"""Standard deviation of what is known of a segment's torsional compliance beforehand."""
LOWER, UPPER = -0.7, 4.0
COARSE = 25
FACTORS = (0.7, 1.0, 1.4, 2.0)
"""Factors on all moduli at which a fit may begin, and the samples of each session that tell which."""
STIFFER = (1.0, 2.0, 2.8, 4.0, 5.6)
"""The same of a slow model."""
LEAST_PRESSURE_SPREAD = 1.0e3
KINDS = ("modulus", "gain", "curve", "alignment", "base")
"""What may be calibrated before an effect is looked for; biases of pressures are effects of valves."""
HUBER = 1.5
SCATTER = {"m": 1.5e-3, "rad": 1.5e-2}
"""Size [m, rad] of an error that a calibrated model is expected to leave; larger ones count less."""
SHARE = 0.1
"""Share of the samples that are worth an independent one: a model's errors are alike for seconds."""
LARGEST_STEP = 0.5
"""Largest change of a modulus' logarithm in one step."""


@dataclass(frozen=True)
class Fitted:
    """A calibration.

    Args:
        layout: The unknowns.
        values: Their values, shape (unknowns,).
        torsion: Torsional compliance of each segment beyond the model's, shape (segments,).
    """

    layout: Layout
    values: Floats
    torsion: Floats

    @property
    def setting(self) -> Setting:
        """What the values stand for."""
        return self.layout.setting(self.values)

    @property
    def vector(self) -> Floats:
        """All values, shape (unknowns + segments,)."""
        return np.concatenate([self.values, self.torsion])

    def moved(self, step: Floats) -> "Fitted":
        """Add a step to all, shape (unknowns + segments,)."""
        count = len(self.values)
        torsion = np.clip(self.torsion + step[count:], LOWER, UPPER)
        return replace(self, values=self.values + step[:count], torsion=torsion)

    def prior_rows(self) -> tuple[Floats, Floats]:
        """Give what is known beforehand as whitened residuals and their derivative; see ``Layout``."""
        known, rows = self.layout.prior_rows(self.values)
        count, segments = len(self.values), len(self.torsion)
        whole = np.zeros((len(known) + segments, count + segments))
        whole[: len(known), :count] = rows
        whole[len(known) :, count:] = np.eye(segments) / TORSION_SPREAD
        return np.concatenate([known, -self.torsion / TORSION_SPREAD]), whole

    def stage(self, model: Model, session: Session) -> Stage:
        """Give a session on the calibrated model; see ``build_stage``."""
        return build_stage(model, session, self.setting, self.torsion)


def layout_of(model: Model, sessions: Sequence[Session]) -> Layout:
    """Choose the unknowns for what a set of sessions shows."""
    measurements = {m.name: m for session in sessions for m in session.suite.measurements}
    spread = np.max([np.ptp(session.pressures, axis=0) for session in sessions], axis=0, initial=0.0)
    moved = [k for k in range(len(spread)) if spread[k] > LEAST_PRESSURE_SPREAD]
    suite = SensorSuite(tuple(measurements.values()))
    segments = [segment.name for segment in model.specimen.segments]
    sources = ["measured"] * len(spread)
    # A known weight in several mounts tells the moduli, so that the chambers' mean gain may be anything.
    weighed = turned(sessions)
    layout = build_layout(model.specimen, suite, sources, moved, segments, weighed)
    kinds = KINDS[:-1] if by_markers(suite) else KINDS
    known = any(session.nominal for session in sessions)
    return layout.without(
        {p.name for p in layout.parameters if p.kind not in kinds or not (known or _open(p))}
    )


def _open(parameter: Parameter) -> bool:
    """Tell whether an unknown may be calibrated on the very recordings in question.

    Gains of chambers and biases of bends are then what is looked for, not what is taken for granted.
    """
    return parameter.kind not in ("gain", "curve") and ".bias" not in parameter.name


def by_markers(suite: SensorSuite) -> bool:
    """Tell whether markers on the base register the laboratory; a recorded frame may be mounted askew."""
    return any(m.registration is not None and m.registration.covariance.any() for m in suite.measurements)


def turned(sessions: Sequence[Session]) -> bool:
    """Tell whether the mount was turned by more than 30 degrees between, or in, some sessions."""
    gravity = np.concatenate([session.gravity for session in sessions])
    sizes = np.linalg.norm(gravity, axis=1)
    return bool((gravity @ gravity[0] < 0.87 * sizes * sizes[0]).any())


def calibrate_sessions(
    model: Model, sessions: Sequence[Session], advance: Callable[[float], None] = lambda _: None
) -> Fitted:
    """Fit moduli, gains, biases and alignments to what sessions show outside their held-out parts.

    Args:
        model: The model.
        sessions: The sessions.
        advance: Called with 1 after every step.
    """
    layout = layout_of(model, sessions)
    seen = [session for session in sessions if not session.heldout.all()]
    parts = [thinned(session.thin(~session.heldout), NODES) for session in seen]
    current = _start(model, layout, parts)
    best, lowest, fewest = current, np.inf, np.inf
    for _ in range(ITERATIONS if model.fast else SLOW_ITERATIONS):
        stages = [current.stage(model, part) for part in parts]
        advance(1.0)
        rows, columns, cost = _equations(stages, layout)
        known, known_rows = current.prior_rows()
        cost += float(known @ known)
        lost = _lost(stages)
        if cost > 1.02 * lowest or lost > fewest:
            current = best.moved(0.5 * (current.vector - best.vector))
            continue
        best, lowest, fewest = (current, cost, lost) if cost < lowest else (best, lowest, fewest)
        normal = columns.T @ columns + known_rows.T @ known_rows
        step = np.asarray(np.linalg.solve(normal, columns.T @ rows + known_rows.T @ known), dtype=np.float64)
        step = _bounded(step, layout)
        current = current.moved(step)
        if np.abs(step[: len(layout.spreads)] / layout.spreads).max() < 1e-3:
            break
    return best


def _start(model: Model, layout: Layout, parts: Sequence[Session]) -> Fitted:
    """Begin with the common factor of all moduli that fits best.

    A slow model begins as it is described or, where it cannot bear the pressures, as soft as it bears most.
    """
    moduli = np.array([parameter.kind == "modulus" for parameter in layout.parameters])
    few = [thinned(part, COARSE) for part in parts]
    plain = np.zeros(len(model.specimen.segments))
    found = []
    for factor in FACTORS if model.fast else STIFFER:
        values = layout.means + np.log(factor) * moduli
        stages = [Fitted(layout, values, plain).stage(model, part) for part in few]
        lost = _lost(stages)
        if lost == 0 and not model.fast:
            return Fitted(layout, values, plain)
        found.append((lost, _equations(stages, layout)[2], values))
    fewest = min(lost for lost, _, _ in found)
    _, best = min((cost, k) for k, (lost, cost, _) in enumerate(found) if lost == fewest)
    return Fitted(layout, found[best][2], plain)


def _lost(stages: Sequence[Stage]) -> int:
    """Count the samples for which the model finds no equilibrium."""
    return sum(int((~stage.arm.baseline.converged).sum()) for stage in stages)


def _bounded(step: Floats, layout: Layout) -> Floats:
    moduli = np.array([parameter.kind == "modulus" for parameter in layout.parameters])
    largest = float(np.abs(step[: len(moduli)][moduli]).max(initial=0.0))
    return step * min(1.0, LARGEST_STEP / max(largest, 1e-12))


def _equations(stages: Sequence[Stage], layout: Layout) -> tuple[Floats, Floats, float]:
    """Stack weighted residuals and columns of all stages; give their robust cost too."""
    lefts, columns, scales = [], [], []
    for stage in stages:
        seen = np.isfinite(stage.residual)
        scale = np.array([SCATTER[unit] for unit in stage.suite.units])
        lefts.append(stage.residual[seen])
        columns.append(np.nan_to_num(stage.calibration_columns(layout))[seen])
        scales.append(np.broadcast_to(scale, seen.shape)[seen])
    left, column, scale = np.concatenate(lefts), np.concatenate(columns), np.concatenate(scales)
    size = np.abs(left) / scale
    weight = np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, 1e-12))) / scale
    loss = np.where(size <= HUBER, size**2, 2.0 * HUBER * size - HUBER**2)
    tempered = weight * np.sqrt(SHARE)
    return left * tempered, column * tempered[:, None], SHARE * float(loss.sum())

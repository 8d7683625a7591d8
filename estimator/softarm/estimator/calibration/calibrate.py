"""Calibration of a specimen on recordings, checked on blocks of them that were left out of the fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.acceptance import (
    LEAST_PRESSURE_SPREAD,
    WORSE,
    CalibrationRefusedError,
    require_convergence,
    require_excitation,
    require_improvement,
    require_motion_predicted,
    require_solutions,
)
from softarm.estimator.calibration.arrange import CalibrationRun
from softarm.estimator.calibration.fit import CalibrationFit, fit, left_out
from softarm.estimator.calibration.force_accuracy import force_accuracy
from softarm.estimator.calibration.force_memory import force_memory_shares
from softarm.estimator.calibration.forward import Forward, NodePredictions
from softarm.estimator.calibration.identifiability import KEPT, fitted, identify, kept
from softarm.estimator.calibration.layout import Layout, build_layout
from softarm.estimator.calibration.nodes import (
    NEVER_SIMULTANEOUS,
    RECORD_SIMULTANEOUSLY,
    Nodes,
    choose_nodes,
    training_blocks,
)
from softarm.estimator.calibration.outcome import Calibrated, Check
from softarm.estimator.calibration.pulled_moduli import FEWEST_PULLS, by_pull, moduli_from_pulls
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.regression import estimate_lag, fit_line
from softarm.estimator.calibration.scatter import rms, scatter_by_condition
from softarm.estimator.calibration.search import AxesFit, search_axes
from softarm.estimator.calibration.start import sized_by_bends, solvable, with_bends_kept
from softarm.estimator.calibration.warm_start import joined, nearest_states
from softarm.estimator.model import Frames
from softarm.estimator.response import BatchArmModel
from softarm.estimator.sensing import Bend, SensorSuite
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.calibration import BendCalibration
from softarm.estimator.specimen.entry import Value

# The time of a fit is proportional to them, and close neighbouring nodes hold nearly the same information.
NODES = 240
PULLED_WEIGHT = 1.5


@dataclass(frozen=True)
class Options:
    """What a calibration may do.

    Args:
        nodes: Largest number of nodes over all runs.
        iterations: Largest number of Gauss-Newton steps of each fit.
        search_axes: Whether to look for the in-plane rotation and handedness of bends; ``None`` looks where
            the specimen has none.
        fit_lag: Whether to bring pressures and motion to one clock.
    """

    nodes: int = NODES
    iterations: int = 15
    search_axes: bool | None = None
    fit_lag: bool = True


def calibrate(
    model: BatchArmModel, specimen: Specimen, runs: Sequence[CalibrationRun], options: Options | None = None
) -> Calibrated:
    """Fit moduli, chamber gains and biases, and the alignment of sensors to recordings.

    The present calibration of the specimen is the prior.

    Args:
        model: Model of the specimen; its loads describe the gauges' pulls.
        specimen: The arm.
        runs: Recordings, each as of ``arrange``.
        options: What to fit and to how many samples.

    Raises:
        CalibrationRefusedError: The recordings hold too little motion, the model finds no equilibrium for
            them, or the fit predicts held-out blocks worse than the old calibration, or the motion in them
            no better than its mean.
    """
    options = options or Options()
    lags, nodes, forward, first, before = _uncalibrated(model, specimen, runs, options)
    prior_means = forward.layout.means
    train = training_flags(nodes)
    unseen = tuple(~flags for flags in train)
    gains: dict[str, AxesFit] = {}
    if _axes_wanted(specimen, options):
        gains = _axes(nodes, before)
        nodes = tuple(replace(run_nodes, run=_with_axes(run_nodes.run, gains)) for run_nodes in nodes)
        # Once more, since the layout begins from the alignment of the sensors.
        forward = _forward(model, specimen, nodes)
    # Kept, since `forward` will hold the moduli near those of the pulls: verdicts compare with the prior
    # before any data.
    prior = forward.layout
    sized = sized_by_bends(specimen, prior, first, gains)
    pulled = moduli_from_pulls(forward, sized, before, train)
    start = with_bends_kept(specimen, prior, sized, pulled.values)
    forward = replace(forward, layout=pulled.near(prior))
    trained, layout = _fit_determined(forward, prior, start, before, train, options)
    require_excitation(layout)
    nearest = nearest_states(
        trained.evaluations, _parts(nodes, train), _subset(before, unseen), _parts(nodes, unseen)
    )
    held_out = _part(replace(forward, layout=layout), unseen).evaluate(trained.values, nearest)
    # Where the arm had to be stiffened to have an equilibrium, the old calibration predicts nothing to
    # compare with.
    old = before if np.array_equal(first, prior_means) else ()
    check = _check(old, trained.evaluations, held_out, nodes, train)
    used_before = bool(set(specimen.calibration.recordings) & {run.name for run in runs})
    require_improvement(check, WORSE if used_before else 1.0)
    require_motion_predicted(
        layout.setting(trained.values), *_judged(held_out, trained.evaluations, nodes, train)
    )
    near = joined(before, trained.evaluations, held_out, train)
    every = tuple(np.ones(len(run_nodes.time), dtype=bool) for run_nodes in nodes)
    # Checked as it is, the model is fitted to everything, the held-out blocks included.
    pulled = moduli_from_pulls(replace(forward, layout=prior), pulled.values, near, every)
    layout = pulled.near(prior).without(set(prior.names) - set(layout.names))
    everything = replace(forward, layout=layout)
    start = with_bends_kept(specimen, layout, trained.values, pulled.moved(layout, trained.values))
    final = fit(everything, start, iterations=options.iterations, evaluations=near)
    require_convergence(final, layout)
    # Held near the pulls' values, the moduli would look more certain than the pulls make them.
    covariance = pulled.widened(layout, final.covariance)
    scatter = scatter_by_condition(*_judged(held_out, trained.evaluations, nodes, train))
    dropped = [p for p in forward.layout.unknowns if p.name not in layout.names]
    pulls = replace(everything, nodes=tuple(map(by_pull, nodes)))
    setting = layout.setting(final.values)
    accuracy = force_accuracy(setting, left_out(pulls, final), pulls.nodes, scatter)
    vented_pulls = pulled.force_accuracy(scatter)
    errors = {**accuracy.errors, **vented_pulls.errors}
    return Calibrated(
        identified=(
            *map(fitted, identify(_prior_of(prior, layout), final.values, covariance)),
            *map(kept, dropped),
        ),
        covariance=covariance,
        mirrored=_handedness(nodes),
        check=check,
        lags=lags,
        status=final.status,
        nodes=sum(len(run_nodes.time) for run_nodes in nodes),
        recordings=tuple(run.name for run in runs),
        scatter=scatter,
        force_ratio={**accuracy.ratios, **vented_pulls.ratios},
        force_error=errors | pulled.unpulled_errors(errors, scatter),
        force_memory=force_memory_shares(setting, final.evaluations, pulls.nodes, scatter),
    )


def with_bend_axes(
    model: BatchArmModel, specimen: Specimen, runs: Sequence[CalibrationRun], options: Options | None = None
) -> Specimen:
    """Find the rotation and the handedness of bends' axes alone; all else stays as described.

    Args:
        model: Model of the specimen.
        specimen: The arm.
        runs: Recordings, each as of ``arrange``.
        options: To how many samples.

    Raises:
        CalibrationRefusedError: The model finds no equilibrium for the recordings.
    """
    _, nodes, _, _, before = _uncalibrated(model, specimen, runs, options or Options())
    entries = {entry.section: entry for entry in specimen.calibration.bends}
    for name, found in _axes(nodes, before).items():
        section = name.removeprefix("bend_")
        entries[section] = BendCalibration(
            section=section,
            rotation_rad=Value(value=found.in_plane),
            mirrored=found.mirrored,
        )
    calibration = specimen.calibration.model_copy(update={"bends": tuple(entries.values())})
    return specimen.model_copy(update={"calibration": calibration})


def _uncalibrated(
    model: BatchArmModel, specimen: Specimen, runs: Sequence[CalibrationRun], options: Options
) -> tuple[tuple[float | None, ...], tuple[Nodes, ...], Forward, Floats, tuple[NodePredictions, ...]]:
    """Predict recordings as the specimen is described.

    Returns:
        The lag of each run, its nodes, the model on them, the parameters at which it has equilibria, and what
        it predicts there.
    """
    # Before the nodes are chosen: each averages pressures and motion of the same instants.
    lags = tuple(estimate_lag(run) if options.fit_lag else None for run in runs)
    nodes = _choose(runs, lags, options.nodes)
    forward = _forward(model, specimen, nodes)
    first = solvable(forward, forward.layout.means)
    before = forward.evaluate(first)
    require_solutions(before, nodes)
    return lags, nodes, forward, first, before


def _axes(nodes: Sequence[Nodes], predicted: Sequence[NodePredictions]) -> dict[str, AxesFit]:
    """Find the axes of bends on the training nodes that were solved."""
    train = training_flags(nodes)
    solved = tuple(flags & part.converged for flags, part in zip(train, predicted, strict=True))
    return search_axes(nodes[0].run.suite, _parts(nodes, solved), _frames(predicted, solved))


def most_solves(options: Options) -> int:
    """Return how many equilibria a calibration solves at most: for showing how far it is.

    All nodes are solved once before and in each step of the last fit, half of them in each step of two fits
    on the training blocks and once to predict the rest.
    """
    return round(options.nodes * (1 + options.iterations + 0.5 + options.iterations))


def training_flags(nodes: Sequence[Nodes]) -> tuple[Flags, ...]:
    """Return which nodes a fit may see: alternate blocks of long runs, else alternate runs, else all."""
    if any(run_nodes.blocks.max(initial=0) >= 1 for run_nodes in nodes):
        return tuple(training_blocks(run_nodes.blocks) for run_nodes in nodes)
    if len(nodes) > 1:
        return tuple(np.full(len(run_nodes.time), number % 2 == 0) for number, run_nodes in enumerate(nodes))
    return tuple(np.ones(len(run_nodes.time), dtype=bool) for run_nodes in nodes)


def _judged(
    held_out: Sequence[NodePredictions],
    trained: Sequence[NodePredictions],
    nodes: Sequence[Nodes],
    train: Sequence[Flags],
) -> tuple[Sequence[NodePredictions], Sequence[Nodes]]:
    """Return the nodes that no fit used and their predictions; all nodes where every one was used."""
    unseen = [~flags for flags in train]
    if any(flags.any() for flags in unseen):
        return held_out, _parts(nodes, unseen)
    return trained, _parts(nodes, train)


def _choose(runs: Sequence[CalibrationRun], lags: Sequence[float | None], count: int) -> tuple[Nodes, ...]:
    aligned = [run.delayed(lag) if lag else run for run, lag in zip(runs, lags, strict=True)]
    durations = [max(float(run.time[-1] - run.time[0]), 1e-3) * _weight(run) for run in aligned]
    # A short run beside long ones keeps a few nodes, or what only it shows would be lost.
    shares = [max(8, round(count * duration / sum(durations))) for duration in durations]
    chosen = tuple(choose_nodes(run, share) for run, share in zip(aligned, shares, strict=True))
    if not sum(len(run_nodes.time) for run_nodes in chosen):
        raise CalibrationRefusedError(
            ", ".join(run.name for run in runs), NEVER_SIMULTANEOUS, RECORD_SIMULTANEOUSLY
        )
    return tuple(run_nodes for run_nodes in chosen if len(run_nodes.time))


def _weight(run: CalibrationRun) -> float:
    """Choose more nodes where a gauge pulls: its readings are coarse, and they determine the stiffness."""
    return PULLED_WEIGHT if run.pulled else 1.0


def _forward(model: BatchArmModel, specimen: Specimen, nodes: tuple[Nodes, ...]) -> Forward:
    pressures = np.concatenate([run_nodes.pressures for run_nodes in nodes])
    moved = [k for k in range(pressures.shape[1]) if np.ptp(pressures[:, k]) > LEAST_PRESSURE_SPREAD]
    sources = nodes[0].run.pressure_source
    measurements = {m.name: m for run_nodes in nodes for m in run_nodes.run.suite.measurements}
    suite = SensorSuite(tuple(measurements.values()))
    pulled = bool(
        sum((np.abs(run_nodes.loads) > LEAST_PULL).any(axis=1).sum() for run_nodes in nodes) > FEWEST_PULLS
    )
    layout = build_layout(specimen, suite, sources, moved, model.regions, pulled, model.sections)
    return Forward(model, layout, nodes)


def _axes_wanted(specimen: Specimen, options: Options) -> bool:
    if options.search_axes is not None:
        return options.search_axes
    return not specimen.calibration.bends


def _with_axes(run: CalibrationRun, axes: Mapping[str, AxesFit]) -> CalibrationRun:
    """Return a run whose bends have the fitted axes."""
    measurements = tuple(
        replace(m, in_plane=axes[m.name].in_plane, mirrored=axes[m.name].mirrored)
        if isinstance(m, Bend) and m.name in axes
        else m
        for m in run.suite.measurements
    )
    return replace(run, suite=SensorSuite(measurements))


def _prior_of(prior: Layout, layout: Layout) -> Layout:
    """Return the prior before any data, of the unknowns of a layout."""
    return prior.without(set(prior.names) - set(layout.names))


def _fit_determined(
    forward: Forward,
    prior: Layout,
    start: Floats,
    before: Sequence[NodePredictions],
    train: Sequence[Flags],
    options: Options,
) -> tuple[CalibrationFit, Layout]:
    """Fit on the training nodes, settle what they do not determine, and fit the rest again."""
    part = _part(forward, train)
    solution = fit(part, start, iterations=options.iterations, evaluations=_subset(before, train))
    verdicts = identify(prior, solution.values, solution.covariance)
    lost = {entry.unknown.name for entry in verdicts if entry.share > KEPT}
    layout = part.layout.without(lost)
    if not lost or not layout.unknowns:
        return solution, layout
    remaining = np.array([name not in lost for name in part.layout.names])
    again = replace(part, layout=layout)
    return fit(
        again, solution.values[remaining], iterations=options.iterations, evaluations=solution.evaluations
    ), layout


def _check(
    before: Sequence[NodePredictions],
    trained: Sequence[NodePredictions],
    held_out: Sequence[NodePredictions],
    nodes: Sequence[Nodes],
    train: Sequence[Flags],
) -> Check:
    unseen = [~flags for flags in train]
    split = any(flags.any() for flags in unseen)
    judged = unseen if split else train
    line, parameters = _line(nodes, train, judged) if split else ({}, 0)
    return Check(
        rms(_subset(before, judged), _parts(nodes, judged)) if before else {},
        rms(trained, _parts(nodes, train)),
        rms(held_out, _parts(nodes, unseen)) if split else {},
        line,
        parameters,
    )


def _line(
    nodes: Sequence[Nodes], train: Sequence[Flags], judged: Sequence[Flags]
) -> tuple[dict[str, float], int]:
    """Judge an ordinary linear regression; it applies only where all sensors are bends."""
    suite = nodes[0].run.suite
    if not all(isinstance(m, Bend) for m in suite.measurements):
        return {}, 0
    fitted, tested = _parts(nodes, train), _parts(nodes, judged)
    line = fit_line(
        np.concatenate([run_nodes.pressures for run_nodes in fitted]),
        np.concatenate([run_nodes.readings for run_nodes in fitted]),
    )
    residual = np.concatenate(
        [run_nodes.readings - line.predict(run_nodes.pressures) for run_nodes in tested]
    )
    names = [f"{m.name}.{axis}" for m in suite.measurements for axis in range(m.size)]
    finite = [column[np.isfinite(column)] for column in residual.T]
    errors = {
        name: float(np.sqrt(np.mean(column**2)))
        for name, column in zip(names, finite, strict=True)
        if len(column)
    }
    return errors, line.parameters


def _part(forward: Forward, flags: Sequence[Flags]) -> Forward:
    return replace(forward, nodes=_parts(forward.nodes, flags))


def _parts(nodes: Sequence[Nodes], flags: Sequence[Flags]) -> tuple[Nodes, ...]:
    return tuple(run_nodes.keep(chosen) for run_nodes, chosen in zip(nodes, flags, strict=True))


def _frames(evaluations: Sequence[NodePredictions], flags: Sequence[Flags]) -> list[Frames]:
    return [part.frames for part in _subset(evaluations, flags)]


def _subset(evaluations: Sequence[NodePredictions], flags: Sequence[Flags]) -> tuple[NodePredictions, ...]:
    return tuple(part.keep(chosen) for part, chosen in zip(evaluations, flags, strict=True))


def _handedness(nodes: Sequence[Nodes]) -> dict[str, bool]:
    bends = [m for run_nodes in nodes for m in run_nodes.run.suite.measurements if isinstance(m, Bend)]
    return {bend.name.removeprefix("bend_"): bend.mirrored for bend in bends}

"""The tool beside what else is done about a mismatch: calibration alone, learned residuals, SINDy.

All see the same recordings of a sealed trial, hanging; all predict the bends of recordings that none has
seen: of the same kind, and with the mount turned.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from acceptance.proof.schedule import SealedTrial
from acceptance.proof.trial import Folders, diagnosed, name_of
from softarm.analysis.offline.inputs import load_recordings
from softarm.analysis.offline.resample import resample
from softarm.bench.trials.run import WRITTEN
from softarm.common.tables import Cell, Table
from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import arrange
from softarm.estimator.effects.accepted import accepted_physics
from softarm.estimator.effects.simulate import simulate_with
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.simulation import Drive, LinearisedArm
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.experiments.excitation_plan import subject_of

EXCITATION = "hanging"
"""What of a trial the methods learn from."""
RATE = 4.0
DEGREES = 57.29577951308232
FULL = 50e3
FEATURES = 400
FADING = (1.0, 5.0, 25.0)
LARGEST = 1.5
"""Samples per second; pressure of one unit; size of the learned map; times of the memory [s]; bend at which a
prediction that runs away is stopped [rad]."""
SMOOTH = tuple((ridge, width) for ridge in (1e-3, 1e-2, 1e-1, 1.0) for width in (1.0, 0.3))
SPARSE = tuple((threshold, degree) for threshold in (5e-3, 2e-2, 1e-1) for degree in (1, 2))
"""Ridges and widths of the learned map; smallest coefficients and degrees of SINDy."""
FOLD = 3
"""Every so-manieth training run is kept from the fits that choose among them."""

TRAINING = tuple(f"run_{number:02d}" for number in range(9))
KNOWN = ("nominal",)
TESTS = {"same_kind": ("run_12",), "mount_turned": ("run_10", "run_11")}
"""Recordings by the beginning of their names."""


Predictor = Callable[["Bends"], Floats]
"""Gives the bends of a recording [rad], shape (samples, bends)."""


@dataclass(frozen=True)
class Bends:
    """The bends over one recording.

    Args:
        time: [s], shape (samples,).
        pressures: [Pa], shape (samples, chambers).
        measured: [rad], shape (samples, bends).
        before: Predicted by the calibrated model.
        after: Predicted with the tool's findings.
    """

    time: Floats
    pressures: Floats
    measured: Floats
    before: Floats
    after: Floats

    @property
    def left(self) -> Floats:
        """What the calibrated model leaves [rad]."""
        return self.measured - self.before

    def features(self, *, memory: bool) -> Floats:
        """Return what a learned map sees: pressures and predicted bends, with memory also faded pressures."""
        parts = [self.pressures / FULL, self.before]
        if memory:
            parts += [faded(self.time, self.pressures / FULL, time) for time in FADING]
        return np.concatenate(parts, axis=1)


def alternatives_table(
    trials: Sequence[SealedTrial], folders: Folders, notify: Callable[[str], None]
) -> Table:
    """Run the comparison.

    Args:
        trials: What is compared on; something is concealed in each.
        folders: Where the proof works.
        notify: Called with progress messages.

    Raises:
        WorkFailedError: The tool gave no report or wrote no specimen.
    """
    errors: dict[str, list[dict[str, float]]] = {}
    for trial in trials:
        diagnosed(trial, EXCITATION, folders, notify)
        notify(f"{trial.name}: predicting")
        for method, error in _errors(trial, folders).items():
            errors.setdefault(method, []).append(error)
    nearest = [min(errors, key=lambda name: errors[name][k]["mount_turned"]) for k in range(len(trials))]
    rows: list[dict[str, Cell]] = [
        {
            "method": method,
            **{kind: float(np.median([one[kind] for one in own])) for kind in own[0]},
            "nearest_in": nearest.count(method),
        }
        for method, own in errors.items()
    ]
    notes = (
        f"Rms error of the four bends in degrees at {RATE:g} per second, median of {len(trials)} single "
        "trials and pairs. All had the same hanging runs. mount_turned: a mount that none has seen. "
        "nearest_in: trials in which a method errs least there.",
        f"Learned: ridge regression on {FEATURES} random Fourier features of pressures and predicted bends; "
        "with memory also of pressures faded over 1, 5 and 25 s. SINDy: pysindy, discrete, of degree 1 or 2. "
        "Ridge and width, threshold and degree are those that best predict a third of the training runs.",
        "How the axes of the bends' sensors lie is learnt from the nominal runs, for all alike.",
    )
    return Table("Alternatives", rows, notes)


def _errors(trial: SealedTrial, folders: Folders) -> dict[str, dict[str, float]]:
    """Return the error of each method on one trial, by what is predicted [degrees]."""
    improved = load_specimen(folders.report(name_of(trial, EXCITATION)) / WRITTEN)
    every = sorted(folders.recordings(trial).iterdir())
    align = alignment([bends(improved, path) for path in every if path.name.startswith(KNOWN)])
    train = [align(bends(improved, path)) for path in every if path.name.startswith(TRAINING)]
    tests = {k: [align(bends(improved, p)) for p in every if p.name.startswith(v)] for k, v in TESTS.items()}
    methods: dict[str, Predictor] = {
        "calibration only": lambda run: run.before,
        "learned residual": chosen_by(train, SMOOTH, partial(learned, memory=False)),
        "learned residual with memory": chosen_by(train, SMOOTH, partial(learned, memory=True)),
        "SINDy on the residual": chosen_by(train, SPARSE, sindy),
        "the tool": lambda run: run.after,
    }
    return {
        name: {
            "training": _error(train, predict),
            **{kind: _error(runs, predict) for kind, runs in tests.items()},
        }
        for name, predict in methods.items()
    }


def chosen_by(
    train: Sequence[Bends],
    options: Sequence[tuple[float, float]],
    fit: Callable[[Sequence[Bends], tuple[float, float]], Predictor],
) -> Predictor:
    """Fit with the option that predicts best the training runs that are kept from its fit."""
    kept = train[FOLD - 1 :: FOLD]
    rest = [run for number, run in enumerate(train) if number % FOLD != FOLD - 1]
    return fit(train, min(options, key=lambda option: _error(kept, fit(rest, option))))


def _error(runs: Sequence[Bends], predict: Predictor) -> float:
    gaps = np.concatenate([run.measured - predict(run) for run in runs])
    return DEGREES * float(np.sqrt(np.nanmean(gaps**2)))


def bends(specimen: Specimen, path: Path) -> Bends:
    """Predict the bends of a recording on a specimen, without and with its physics."""
    (loaded,) = load_recordings([path])
    run = resample(arrange(loaded, specimen), RATE)
    suite = SensorSuite(tuple(sensor for sensor in run.suite.measurements if sensor.name.startswith("bend")))
    rows = _rows_of(run.suite, suite)
    subject = subject_of(specimen, [sensor.name for sensor in suite.measurements])
    gravity = np.array(loaded.info.get("gravity_m_s2", specimen.gravity_m_s2))
    acting = _acting(specimen, run.pressures)
    sections = len(subject.world.sections)
    drive = Drive.of(run.time + loaded.start, acting, gravity, sections, subject.segments.count)
    response = subject.arm.respond(drive)
    arm = LinearisedArm(subject.segments, drive, response)
    names = [sensor.name for sensor in suite.measurements]
    found = [
        simulate_with(effects, arm, subject.world, drive, suite).readings
        for effects in ((), accepted_physics(specimen, subject.world))
    ]
    before, after = (np.concatenate([one[name] for name in names], axis=1) for one in found)
    return Bends(run.time, run.pressures, run.readings[:, rows], before, after)


def alignment(known: Sequence[Bends]) -> Callable[[Bends], Bends]:
    """Learn from nominal recordings how the axes of each bend's sensor lie, for every method alike.

    A sensor's two axes are a linear map of the model's, and an offset; the frames that the tool calibrates
    on are mounted otherwise.
    """
    predicted = np.concatenate([run.before for run in known])
    measured = np.concatenate([run.measured for run in known])
    maps = []
    for first in range(0, predicted.shape[1], 2):
        own = slice(first, first + 2)
        rows = np.column_stack([predicted[:, own], np.ones(len(predicted))])
        good = np.isfinite(rows).all(axis=1) & np.isfinite(measured[:, own]).all(axis=1)
        maps.append(np.linalg.lstsq(rows[good], measured[good, own], rcond=None)[0])

    def turned(values: Floats) -> Floats:
        parts = [values[:, 2 * k : 2 * k + 2] @ one[:2] + one[2] for k, one in enumerate(maps)]
        return np.concatenate(parts, axis=1)

    return lambda run: replace(run, before=turned(run.before), after=turned(run.after))


def _acting(specimen: Specimen, pressures: Floats) -> Floats:
    sections = tuple(section.name for section in specimen.sections)
    return SpecimenSensors(specimen, sections, Registration()).actuation().to_chamber(pressures)


def _rows_of(whole: SensorSuite, part: SensorSuite) -> list[int]:
    """List the entries of the whole suite's readings that belong to a part of it."""
    slices = [whole.reading_slices[sensor.name] for sensor in part.measurements]
    return [entry for own in slices for entry in range(own.start, own.stop)]


def faded(time: Floats, values: Floats, constant: float) -> Floats:
    """Let values fade in: first-order filter with a time constant [s], from its first value."""
    out = np.empty_like(values)
    out[0] = values[0]
    for k in range(1, len(time)):
        share = 1.0 - np.exp(-(time[k] - time[k - 1]) / constant)
        out[k] = out[k - 1] + share * (values[k] - out[k - 1])
    return out


def learned(train: Sequence[Bends], option: tuple[float, float], *, memory: bool) -> Predictor:
    """Fit a smooth map from features to what the model leaves; give the corrected prediction.

    Args:
        train: What it learns from.
        option: Ridge, and how fast the map may change.
        memory: Whether it sees faded pressures.
    """
    ridge, width = option
    inputs = np.concatenate([run.features(memory=memory) for run in train])
    wanted = np.concatenate([run.left for run in train])
    good = np.isfinite(wanted).all(axis=1) & np.isfinite(inputs).all(axis=1)
    mean, scale = inputs[good].mean(axis=0), inputs[good].std(axis=0) + 1e-9
    rng = np.random.default_rng(0)
    directions = width * rng.normal(size=(inputs.shape[1], FEATURES)) / np.sqrt(inputs.shape[1])
    phases = rng.uniform(0.0, 2.0 * np.pi, FEATURES)

    def lifted(values: Floats) -> Floats:
        waves: Floats = np.cos(((values - mean) / scale) @ directions + phases)
        return waves

    rows = lifted(inputs[good])
    weights = np.linalg.solve(rows.T @ rows + ridge * len(rows) * np.eye(FEATURES), rows.T @ wanted[good])

    def predict(run: Bends) -> Floats:
        corrected: Floats = run.before + lifted(run.features(memory=memory)) @ weights
        return corrected

    return predict


def sindy(train: Sequence[Bends], option: tuple[float, float]) -> Predictor:
    """Identify how the residual goes on from sample to sample; give the prediction run from zero.

    Args:
        train: What it learns from.
        option: Smallest coefficient that is kept, and degree of the polynomials.
    """
    import pysindy  # an extra of this benchmark

    threshold, degree = option
    model = pysindy.DiscreteSINDy(
        optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-3),
        feature_library=pysindy.PolynomialLibrary(degree=int(degree)),
    )
    states = [np.nan_to_num(run.left) for run in train]
    model.fit(states, t=1.0 / RATE, u=[run.features(memory=False) for run in train])

    def predict(run: Bends) -> Floats:
        features = run.features(memory=False)
        state, path = np.zeros((1, run.left.shape[1])), []
        for row in features:
            path.append(state[0])
            state = np.clip(np.asarray(model.predict(state, u=row[None])), -LARGEST, LARGEST)
        return np.asarray(run.before + np.array(path))

    return predict

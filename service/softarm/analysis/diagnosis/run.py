"""From the paths of recordings to a diagnosis."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain
from pathlib import Path

import numpy as np

from softarm.analysis.diagnosis.intake import check_recordings, with_intakes, with_touches
from softarm.analysis.diagnosis.models import finite_element_model, rod_model
from softarm.analysis.offline.inputs import distinct_names
from softarm.common.rods import QUICK, fitted_rod, known_rod, trusted
from softarm.estimator.calibration import (
    Calibrated,
    CalibrationRefusedError,
    Check,
    MotionNotPredictedError,
    NotImprovedError,
    Options,
    arrange,
    calibrate,
    calibrated_specimen,
    with_bend_axes,
)
from softarm.estimator.calibration.identifiability import identify
from softarm.estimator.diagnosis.admit import Admitted, admit, motion_columns, usable
from softarm.estimator.diagnosis.diagnose import Assembled, DiagnosisOutcome, diagnose
from softarm.estimator.diagnosis.prepare import LEAST_BLOCKS, averaged, blocks_of, prepare
from softarm.estimator.diagnosis.release import find_release
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Model
from softarm.estimator.diagnosis.stuck import stuck_findings, stuck_notes
from softarm.estimator.diagnosis.valve_stage import splits_of, valve_findings
from softarm.estimator.diagnosis.valve_verdict import (
    not_compared,
    not_judged,
    valve_diagnosis,
    wrong_sensors,
)
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.accepted import physics_entry
from softarm.estimator.errors import InputError, suggest
from softarm.estimator.intake import Intake
from softarm.estimator.intake.stuck_pressures import stuck_pressures, without_pressures
from softarm.estimator.recording import Recording
from softarm.estimator.rod import CalibratedRod, FittedRod, adapted
from softarm.estimator.sensing import Bend
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import EffectName
from softarm.recordings import load_recording
from softarm.recordings.load import data_file

SAMPLES = 9000
"""Largest number of samples over all recordings."""
STEP = 0.1
"""Shortest window of a mean in long recordings [s]."""
SHORT = 20.0
"""Shorter recordings [s] keep their own rate, or get windows that fit their vibration."""
CHECK_NAMES = "check that columns name the right chambers, sensors and units, or calibrate the specimen"
SLOWEST, FASTEST = 1.5, 15.0
"""Frequencies between which soft arms and beams vibrate [Hz]."""
FEW = 400
"""Different inputs up to which finite elements are fast enough."""


@dataclass(frozen=True)
class DiagnosisRequest:
    """What to diagnose.

    Args:
        recordings: Recordings in question.
        nominal: Recordings of the arm in its known state.
        specimen: The robot.
        seed: Of everything random.
        effects: Effects to try; all when empty.
    """

    recordings: tuple[Path, ...]
    nominal: tuple[Path, ...]
    specimen: Specimen
    seed: int = 0
    effects: tuple[str, ...] = ()


def run(
    request: DiagnosisRequest,
    executor: Executor,
    advance: Callable[[str], None] = lambda _: None,
    keep: Callable[[Assembled], None] = lambda _: None,
    notify: Callable[[str], None] = lambda _: None,
) -> DiagnosisOutcome:
    """Diagnose recordings.

    Args:
        request: What to diagnose.
        executor: Runs independent work.
        advance: Called with what is being done.
        keep: Called with the residuals and columns, before the search for effects.
        notify: Called with what was set aside, left out of the recordings, or assumed.

    Raises:
        InputError: A recording cannot be read, does not fit the specimen, or cannot decide anything.
    """
    began = time.monotonic()
    advance("reading")
    effects = _known(request.effects)
    suspects, nominal, unread = loaded(request, notify)
    suspects, nominal, intakes, found = check_recordings(suspects, nominal, request.specimen, notify)
    admitted = admit(suspects, nominal, request.specimen, notify)
    questioned = {recording.name for recording in admitted.suspects}
    intakes, found = tuple(i for i in intakes if i.recording.name in questioned), (*unread, *found)
    stuck = tuple(one for recording, _ in admitted.all for one in stuck_pressures(recording))
    valves, known_valves = (
        splits_of([without_pressures(recording, stuck) for recording in group])
        for group in (admitted.suspects, admitted.nominal)
    )
    faults = (
        *valve_findings(valves, known_valves),
        *stuck_findings([one for one in stuck if one.recording in questioned]),
    )
    idle = (*not_judged(admitted, (*valves, *known_valves)), *not_compared(valves, known_valves))
    for words in idle:
        notify(words)
    admitted = admitted.mended(
        lambda one: without_pressures(one, stuck, by_set_points=True), (*stuck_notes(stuck), *idle)
    )
    if not any(motion_columns(recording) for recording in admitted.suspects):
        diagnosis = valve_diagnosis(request.specimen.name, admitted, valves, faults, known_valves)
        diagnosis = with_intakes(diagnosis, intakes, found)
        return DiagnosisOutcome(replace(diagnosis, seconds=time.monotonic() - began), (), ())
    known = known_rod(request.specimen)

    @cache
    def rod() -> CalibratedRod:
        """Return the shipped or cached rod, else one that is fitted to few samples and kept."""

        def fitting(done: int, whole: int) -> None:
            advance(f"fitting the rod, {done} of {whole}")

        return adapted((known or fitted_rod(request.specimen, fitting, QUICK)).rod, request.specimen)

    if _on_mesh(request.specimen, admitted, known):
        model = finite_element_model(request.specimen)
    else:
        advance("preparing the model")
        model = rod_model(request.specimen, rod())
    sessions, notes = sessions_of(admitted, request.specimen, model, intakes, notify)
    if _without_axes(request.specimen, sessions):
        advance("finding the axes of bends")
        arranged = admitted.only({session.name for session in sessions})
        specimen, words = with_axes(request.specimen, arranged, model.sections, rod())
        model = replace(model, specimen=specimen)
        sessions, notes = sessions_of(admitted, specimen, model, intakes)
        notes = (*notes, words)
    if model.fast and known is not None and not trusted(known):
        error = 100.0 * known.report.trained.force_rms
        notes = (*notes, f"The calibrated rod is {error:.1f} % of range off the finite elements in force.")
    outcome = diagnose(
        model, sessions, executor, seed=request.seed, notes=notes, effects=effects, advance=advance, keep=keep
    )
    beyond = outcome.fitted.beyond_prior if outcome.fitted is not None else ()
    intakes, known_touches = with_touches(intakes, admitted.nominal, outcome.touches)
    found = (*found, *(touch.statement for touch in known_touches), *beyond)
    wrong = wrong_sensors(outcome.diagnosis.findings, faults)
    diagnosis = with_intakes(
        outcome.diagnosis.with_faults(faults), intakes, (*found, *wrong), outcome.event_errors
    )
    diagnosis = replace(diagnosis, seconds=time.monotonic() - began)
    return replace(outcome, diagnosis=diagnosis)


def loaded(
    request: DiagnosisRequest, notify: Callable[[str], None] = lambda _: None
) -> tuple[tuple[Recording, ...], tuple[Recording, ...], tuple[str, ...]]:
    """Load recordings; those that cannot be read are set aside.

    Args:
        request: Which recordings.
        notify: Called with what was set aside, and why.

    Returns:
        The recordings in question, the nominal ones, and what was set aside and why.

    Raises:
        InputError: None of a kind can be read, one is given twice, or there is no such file.
    """
    for path in (*request.recordings, *request.nominal):
        data_file(path)  # a path that was mistyped ends the diagnosis
    notes: list[str] = []
    groups = [
        usable(group, lambda path: (path, load_recording(path, units_checked=False)), notes, notify)
        for group in (request.recordings, request.nominal)
    ]
    paths, recordings = zip(*chain(*groups), strict=True)
    names = distinct_names([recording.name for recording in recordings], paths)
    named = tuple(replace(recording, name=name) for recording, name in zip(recordings, names, strict=True))
    count = len(groups[0])
    return named[:count], named[count:], tuple(notes)


def _without_axes(specimen: Specimen, sessions: Sequence[Session]) -> bool:
    sensors = [m for session in sessions for m in session.suite.measurements]
    return not specimen.calibration.bends and any(isinstance(sensor, Bend) for sensor in sensors)


def with_axes(
    specimen: Specimen, admitted: Admitted, sections: tuple[str, ...], rod: CalibratedRod
) -> tuple[Specimen, str]:
    """Calibrate a specimen whose bends' axes are unknown; every fourth stretch of time stays unseen.

    Raises:
        InputError: However the axes lie, the model predicts the motion no better than its mean does.
    """
    chosen = admitted.nominal or tuple(
        recording.window(np.asarray(blocks_of(recording.time) % 4 != 2)) for recording in admitted.suspects
    )
    runs = [arrange(recording, specimen, sections) for recording in chosen]
    words = (
        "Rotation and handedness of the bends' axes were found before anything else, outside held-out time"
    )
    try:
        found = calibrate(rod.with_loads(()), specimen, runs, Options(search_axes=True))
    except MotionNotPredictedError as refusal:
        names = ", ".join(recording.name for recording in chosen)
        raise InputError(names, f"however the axes of the bends lie, {refusal.what}", CHECK_NAMES) from None
    except NotImprovedError as refusal:
        words += f"; nothing else was calibrated so, since {refusal.what}"
        return with_bend_axes(rod.with_loads(()), specimen, runs), f"{words}."
    except CalibrationRefusedError as refusal:
        return specimen, f"The axes of the bends stay as described: {refusal}"
    return calibrated_specimen(specimen, found), f"{words}."


def improved_specimen(specimen: Specimen, outcome: DiagnosisOutcome) -> Specimen:
    """Write findings into a specimen; an effect replaces one of its kind at its place.

    A specimen that was calibrated stays so: the diagnosis calibrates on the rod, which is coarser than the
    finite elements that a calibration is for. One that was not gets what the diagnosis found.
    """
    if not specimen.calibration.modulus_scale:
        specimen = _calibrated(specimen, outcome)
    entries = [
        physics_entry(placed, stds, outcome.diagnosis.recordings)
        for placed, stds in zip(outcome.accepted, outcome.stds, strict=True)
    ]
    new = {(entry.effect, entry.where) for entry in entries}
    kept = [entry for entry in specimen.physics if (entry.effect, entry.where) not in new]
    return specimen.model_copy(update={"physics": (*kept, *entries)})


def effects_outside_model(outcome: DiagnosisOutcome) -> tuple[str, ...]:
    """Name what was found but is no physics of the model: faults of valves, events, unknowns."""
    accepted = {(placed.effect.name, placed.spot.place) for placed in outcome.accepted}
    found = outcome.diagnosis.findings
    return tuple(dict.fromkeys(one.effect for one in found if (one.effect, one.where) not in accepted))


def _calibrated(specimen: Specimen, outcome: DiagnosisOutcome) -> Specimen:
    fitted = outcome.fitted
    if fitted is None:
        return specimen
    diagnosis = outcome.diagnosis
    names = diagnosis.nominal or diagnosis.recordings
    found = Calibrated(
        identified=identify(fitted.layout, fitted.values, outcome.covariance),
        covariance=outcome.covariance,
        mirrored={
            section: specimen.calibration.bend(section).mirrored
            for section in (s.name for s in specimen.sections)
            if f"bend_{section}.in_plane" in fitted.layout.names
        },
        check=Check({}, {}, {}, {}, 0),
        lags=(),
        status="converged",
        nodes=0,
        recordings=names,
        scatter={},
        force_ratio={},
        force_error={},
    )
    return calibrated_specimen(specimen, found, "by softarm diagnose, before any effect was looked for")


def sessions_of(
    admitted: Admitted,
    specimen: Specimen,
    model: Model,
    intakes: Sequence[Intake] = (),
    notify: Callable[[str], None] = lambda _: None,
) -> tuple[tuple[Session, ...], tuple[str, ...]]:
    """Bring all recordings to the rate of a diagnosis; those that do not fit the arm are set aside.

    Args:
        admitted: Recordings as fits may see them.
        specimen: The robot.
        model: Its model.
        intakes: Hold what some of them read during events, which goes beside what fits may see.
        notify: Called with what was set aside, and why.

    Raises:
        InputError: None in question, or no nominal one, fits the arm or holds its motion.
    """
    eventful = {intake.recording.name: intake for intake in intakes if intake.events}
    notes = list(admitted.notes)

    def brought(recording: Recording, *, nominal: bool) -> tuple[Session, float]:
        """Return a session at its own rate, and the window of its means [s]."""
        if not motion_columns(recording):
            what = "holds no motion of the arm, only valves, which are compared by themselves"
            raise InputError(
                recording.name, what, "record the arm's bends, frames or markers along with them"
            )
        intake = eventful.get(recording.name)
        prepared = prepare(
            intake.with_events(recording) if intake else recording,
            specimen,
            model.sections,
            nominal=nominal,
            events=[event.interval for event in intake.events] if intake else (),
        )
        notes.extend(prepared.notes)
        frequency = vibration_frequency(prepared.session)
        release = find_release(prepared.session, frequency)
        if release is not None:
            notes.append(
                f"{recording.name}: released at {release.time:.2f} s and vibrates at {frequency:.2f} Hz; "
                "only what follows the vibration is used."
            )
        session = release.session if release else prepared.session
        return session, _step(session, frequency)

    groups = (
        usable(group, partial(brought, nominal=nominal), notes, notify)
        for group, nominal in ((admitted.nominal, True), (admitted.suspects, False))
    )
    native, steps = zip(*chain(*groups), strict=True)
    total = sum(session.seconds / step for session, step in zip(native, steps, strict=True))
    stretch = max(1.0, total / SAMPLES)
    sessions = tuple(averaged(one, step * stretch) for one, step in zip(native, steps, strict=True))
    longest = max(float(session.step) for session in sessions)
    notes.append(
        f"Readings were averaged over windows of up to {longest:.2f} s: "
        f"{sum(session.samples for session in sessions)} samples in all."
    )
    return sessions, tuple(dict.fromkeys(notes))


def _step(session: Session, frequency: float | None) -> float:
    """Choose a window [s]: long enough to average a vibration away, short enough to see lags."""
    if session.natural_frequency is not None:
        # At rest it shows one pose: more means would only repeat what the model gets wrong of it.
        return session.seconds / LEAST_BLOCKS
    if session.seconds >= SHORT:
        return STEP
    return max(session.step, min(2.0 / frequency, session.seconds / 8.0)) if frequency else session.step


def vibration_frequency(session: Session) -> float | None:
    """Find the frequency of a vibration of a soft arm [Hz]; ``None`` where there is none.

    At least half of the power of the speed lies between ``SLOWEST`` and ``FASTEST``, as far as the rate
    resolves them, and the recording lasts for at least two periods of the slowest.
    """
    readings = session.readings[:, np.isfinite(session.readings).any(axis=0)]
    count = len(readings)
    if session.seconds < 2.0 / SLOWEST:
        return None
    column = readings[:, int(np.argmax(np.nanstd(readings, axis=0)))]
    rates = np.gradient(np.nan_to_num(column, nan=float(np.nanmean(column))))
    power = np.abs(np.fft.rfft(rates - rates.mean())) ** 2
    frequencies = np.fft.rfftfreq(count, session.step)
    band = (frequencies >= SLOWEST) & (frequencies <= FASTEST)
    if not band.any() or power[band].sum() < 0.5 * power.sum():
        return None
    return float(frequencies[band][int(np.argmax(power[band]))])


def _on_mesh(specimen: Specimen, admitted: Admitted, known: FittedRod | None) -> bool:
    """Return whether the recordings hold so few different inputs that finite elements are fast enough."""
    if specimen.geometry.kind != "block" and known is not None:
        return False
    distinct = 0
    for recording, _ in admitted.all:
        pressures = [recording.pressure(k)[0] for k in recording.chambers]
        if pressures:
            distinct += len(np.unique(np.round(np.nan_to_num(np.column_stack(pressures)), -2), axis=0))
    return distinct <= FEW


def _known(names: Sequence[str]) -> list[EffectName] | None:
    """Return the effects of some names, in the order of the library; ``None`` stands for all."""
    for name in names:
        if name not in EFFECTS:
            cure = suggest(name, EFFECTS, f"choose among {', '.join(EFFECTS)}")
            raise InputError("--effect", f"{name!r} is not a known effect", cure)
    return [effect.name for effect in EFFECTS.values() if effect.name in names] or None

"""What the valves do otherwise than asked, or otherwise than in nominal recordings, as findings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.judge import bootstrap
from softarm.estimator.diagnosis.result import (
    ChannelError,
    Evidence,
    Finding,
    Quantity,
    Rival,
)
from softarm.estimator.diagnosis.valves import (
    LAGS,
    OPEN,
    SETTLED,
    Gain,
    Timing,
    Valve,
    ceilings_of,
    gains_of,
    predict,
    reading_interval,
    valves_of,
)
from softarm.estimator.recording import Recording
from softarm.estimator.specimen.physics import EffectName, Place

LEAST_BIAS = 300.0
"""Steady error [Pa], and change of it, from which it is reported."""
LEAST_DELAY = 0.015
"""Change of dead time and lag together [s] from which it is reported."""
LEAST_BAND = 300.0
"""Set-point [Pa] without effect, beyond that of nominal recordings, from which a dead band is seen."""
LEAST_LOSS = 3000.0
"""Highest set-point over a ceiling [Pa] from which that is reported."""
BY_CHANCE = 0.01
"""Probability over all valves below which a change is reported: at most 1 of 100 names is false."""
CEILING_STD = 100.0
"""Standard deviation of a pressure that is not passed [Pa]."""
LEAST_STD = 20.0
"""Least standard deviation of a steady error [Pa]: few holds may by chance scatter less."""
RESOLUTION = 30.0
"""Noise below which no pressure is believed [Pa]."""
LEAST_BIC = 10.0
"""Evidence on held-out samples from which a valve is blamed."""
DEADBAND = 2.0 / 3.0
"""Probability of a dead band where a pressure has become too low in a way that a bias explains as well.

A dead band can only lower a pressure; of biases that come up, half do. Without nominal recordings both are as
likely: valves that are as they should be regulate low by themselves, by 0.45 to 0.85 kPa on SoPrA.
"""
SCATTER, BETWEEN_HOLDS, WORTH = 200.0, 100.0, 3
"""Scatter of a steady error between recordings, between holds [Pa]; how many of either this is worth."""


@dataclass(frozen=True)
class Split:
    """A valve's law, and what it predicts of one part of a recording if it is learnt from the other.

    Args:
        recording: Its name.
        valve: The law from the whole recording, which is reported.
        time: Of the whole recording [s], shape (samples,).
        setpoint: Set-points [Pa], shape (samples,).
        measured: Measured pressures [Pa], shape (samples,).
        predicted: What the law from the first part gives [Pa], shape (samples,).
        heldout: Samples that this law has not seen, shape (samples,).
    """

    recording: str
    valve: Valve
    time: Floats
    setpoint: Floats
    measured: Floats
    predicted: Floats
    heldout: NDArray[np.bool_]

    def errors(self) -> tuple[float, float]:
        """Return the root mean square on unseen samples of set-point and of law against pressure [Pa]."""
        heldout = self.heldout
        setpoint, law = (
            self.measured[heldout] - self.setpoint[heldout],
            self.measured[heldout] - self.predicted[heldout],
        )
        return float(np.sqrt(np.mean(setpoint**2))), float(np.sqrt(np.mean(law**2)))

    @property
    def floor(self) -> float:
        """Noise by which errors are divided [Pa]."""
        return max(self.valve.noise, RESOLUTION)

    @property
    def unseen_seconds(self) -> float:
        """Time that the law has not seen [s]."""
        return float(self.heldout.sum() * np.median(np.diff(self.time)))

    @property
    def activity(self) -> float:
        """Root mean square change of the set-point within a settling time, on unseen samples [Pa]."""
        change = self.setpoint - np.interp(self.time - SETTLED, self.time, self.setpoint)
        return float(np.sqrt(np.mean(change[self.heldout] ** 2)))


@dataclass(frozen=True)
class ComparedValve:
    """One valve in question beside what nominal recordings show of it.

    Args:
        chamber: Its chamber.
        splits: What was learnt of it from the recordings in question.
        references: The same from nominal recordings.
        evidence: How well its laws predict what they have not seen.
        valves: Number of valves that were looked at.
    """

    chamber: int
    splits: Sequence[Split]
    references: Sequence[Split]
    evidence: Evidence
    valves: int


def splits_of(recordings: Sequence[Recording]) -> list[Split]:
    """Learn each valve's law from the first half of its activity in each recording."""
    splits = []
    ceilings = ceilings_of(recordings)
    gains = gains_of(recordings, ceilings)
    valves = [
        (recording, valve) for recording in recordings for valve in valves_of(recording, ceilings, gains)
    ]
    for chamber in sorted({valve.chamber for _, valve in valves}):
        chosen = [(recording, valve) for recording, valve in valves if valve.chamber == chamber]
        middles = [_middle(recording, chamber) for recording, _ in chosen]
        early = [_until(r, chamber, middle) for (r, _), middle in zip(chosen, middles, strict=True)]
        met = ceilings_of(early)
        found = gains_of(early, met)
        for (recording, whole), half, middle in zip(chosen, early, middles, strict=True):
            time, setpoint, measured = recording.time, *_columns(recording, chamber)
            if not np.isfinite(setpoint[time > middle] + measured[time > middle]).any():
                continue
            learnt = {valve.chamber: valve for valve in valves_of(half, met, found)}
            if chamber not in learnt:  # too few readings
                continue
            observed = np.isfinite(setpoint) & np.isfinite(measured)
            splits.append(
                Split(
                    recording.name,
                    whole,
                    time[observed],
                    setpoint[observed],
                    measured[observed],
                    predict(learnt[chamber], time[observed], setpoint[observed]),
                    time[observed] > middle,
                )
            )
    return splits


def _columns(recording: Recording, chamber: int) -> tuple[Floats, Floats]:
    """Return set-points and pressures of a chamber [Pa], shape (samples,)."""
    return recording.columns[f"pressure_cmd_{chamber}_pa"], recording.columns[f"pressure_{chamber}_pa"]


def _until(recording: Recording, chamber: int, end: float) -> Recording:
    """Cut out what one valve did before a time [s]."""
    setpoint, measured = _columns(recording, chamber)
    columns = {f"pressure_cmd_{chamber}_pa": setpoint, f"pressure_{chamber}_pa": measured}
    return replace(recording, columns=columns).window(np.asarray(recording.time <= end))


def _middle(recording: Recording, chamber: int) -> float:
    """Return the middle of the time in which a valve is open [s]."""
    setpoint, _ = _columns(recording, chamber)
    active = recording.time[np.nan_to_num(setpoint) > OPEN]
    return float(0.5 * (active[0] + active[-1]))


def valve_findings(suspects: Sequence[Split], nominal: Sequence[Split]) -> tuple[Finding, ...]:
    """Report what the valves do otherwise; of those that nominal recordings leave out, a ceiling alone."""
    findings: list[Finding] = []
    scatter = _scatter(_offsets, SCATTER, [suspects, nominal])
    between_holds = _between_holds([*suspects, *nominal])
    jitter = _scatter(_delayed, max((_jitter(split) for split in suspects), default=0.0), [suspects, nominal])
    chambers = sorted({split.valve.chamber for split in suspects})
    for chamber in chambers:
        splits, references = of_chamber(suspects, chamber), of_chamber(nominal, chamber)
        evidence = _evidence(splits)
        valve = ComparedValve(chamber, splits, references, evidence, len(chambers))
        findings += _ceiling(valve)
        if nominal and not references:
            continue
        if 2.0 * evidence.log_bayes_factor >= LEAST_BIC and evidence.heldout_after < evidence.heldout_before:
            findings += _steady(valve, scatter, between_holds)
            findings += _gain(valve, scatter, between_holds)
            findings += _delays(valve, jitter)
    return tuple(findings)


def of_chamber(splits: Sequence[Split], chamber: int) -> list[Split]:
    """List what was learnt of one valve."""
    return [split for split in splits if split.valve.chamber == chamber]


def _scatter(
    measured: Callable[[Sequence[Split]], list[float]], prior: float, groups: Sequence[Sequence[Split]]
) -> float:
    """Pool how far what is measured of one valve lies apart between recordings of one state.

    Args:
        measured: Gives it for recordings of one valve.
        prior: Its scatter before anything is seen, worth ``WORTH`` recordings.
        groups: Recordings by state.
    """
    squares, count = 0.0, 0
    for group in groups:
        for chamber in {split.valve.chamber for split in group}:
            deviations = np.array(measured(of_chamber(group, chamber)))
            squares += float(np.sum((deviations - deviations.mean()) ** 2)) if len(deviations) else 0.0
            count += max(len(deviations) - 1, 0)
    return _pooled(prior, squares, count)


def _between_holds(splits: Sequence[Split]) -> float:
    """Pool the scatter of a steady error between the holds of one recording over all valves [Pa].

    One hold, or two shortly after each other, do not determine it.
    """
    several = [split.valve.law for split in splits if split.valve.law.holds > 1]
    squares = sum((law.holds - 1) * law.bias_std**2 for law in several)
    return _pooled(BETWEEN_HOLDS, squares, sum(law.holds - 1 for law in several))


def _pooled(prior: float, squares: float, count: int) -> float:
    """Return a scatter of which a prior is worth ``WORTH`` differences beside those that were seen.

    Args:
        prior: The scatter before anything is seen.
        squares: Sum of the squared differences from their mean.
        count: Their degrees of freedom.
    """
    return float(np.sqrt((WORTH * prior**2 + squares) / (WORTH + count)))


def _jitter(split: Split) -> float:
    """Return the scatter of a delay of which only the reading is known in which it ends [s]."""
    return reading_interval(split.time, split.measured) / float(np.sqrt(12.0))


def _ceiling(valve: ComparedValve) -> list[Finding]:
    """Report a pressure that is not passed; a law learnt before it was met cannot be judged by it."""
    met = [split.valve.law.ceiling for split in valve.splits]
    met = [ceiling for ceiling in met if np.isfinite(ceiling.pressure)]
    if not met or any(np.isfinite(split.valve.law.ceiling.pressure) for split in valve.references):
        return []
    ceiling = float(np.median([one.pressure for one in met]))
    lost = max(float(split.setpoint.max()) for split in valve.splits) - ceiling
    if lost <= LEAST_LOSS:
        return []
    words = f"The pressure in chamber {valve.chamber} stops at {1e-3 * ceiling:.1f} kPa, below its set-point."
    quantity = {"ceiling": Quantity(ceiling, CEILING_STD, "Pa")}
    sure = _probability(lost, CEILING_STD, len(met)) * (1.0 - max(one.chance for one in met))
    return [_finding("pressure_saturation", valve, words, quantity, sure, "pressure level")]


def _steady(valve: ComparedValve, scatter: float, between_holds: float) -> list[Finding]:
    """Report a steady error, or one that is new where there are nominal recordings."""
    splits, references = valve.splits, valve.references
    ours, theirs = _offsets(splits), _offsets(references)
    if not ours or (references and not theirs):
        return []
    change = float(np.mean(ours)) - (float(np.mean(theirs)) if theirs else 0.0)
    within = max(between_holds, *(split.valve.law.bias_std for split in splits))
    spread = _spread(within, scatter, len(ours), len(theirs))

    def surely(size: float) -> float:
        return _probability(abs(size), spread, len(ours) + len(theirs), valve.valves)

    # What is read when vented as well is an offset of the sensor and no property of the valve.
    vented = _vented_change(splits, references)
    offset, opened = (
        size if abs(size) > LEAST_BIAS and surely(size) >= 1.0 - BY_CHANCE else 0.0
        for size in (vented, change - vented)
    )
    band = max((split.valve.law.deadband for split in references), default=0.0) + LEAST_BAND
    seen = any(split.valve.law.deadband > band for split in splits)
    findings = []
    if opened < 0.0 and (seen or (references and not offset)):
        findings.append(_deadband(valve, -opened, spread, surely(opened), seen=seen))
        opened = 0.0
    if not offset and not opened:
        return findings
    size = offset + opened
    words = f"The pressure in chamber {valve.chamber} is off by {1e-3 * size:+.2f} kPa"
    words += " while its valve is open." if opened else ", open or vented."
    if offset and opened:
        words += f" Vented, its sensor reads {1e-3 * offset:+.2f} kPa."
    rivals = (_alike("valve_deadband", valve.chamber, 0.0),) if opened < 0.0 else ()
    findings.append(
        _finding(
            "pressure_bias",
            valve,
            words,
            {"bias": Quantity(size, spread, "Pa")},
            max(surely(offset), surely(opened)) / (1 + len(rivals)),
            "pressure level" if opened else "constant",
            rivals,
        )
    )
    return findings


def _gain(valve: ComparedValve, scatter: float, between_holds: float) -> list[Finding]:
    """Report an error that grows with the set-point, by what it amounts to at the highest set-point."""
    splits, references = valve.splits, valve.references
    ours, theirs = (group[0].valve.law.gain if group else Gain() for group in (splits, references))
    if not ours.std or (references and not theirs.std):
        return []
    change = (1.0 + ours.value) / (1.0 + theirs.value) - 1.0
    highest = max(float(split.setpoint.max()) for split in splits)
    other = _spread(between_holds, scatter, len(splits), len(references))
    spread = float(np.hypot(other, highest * np.hypot(ours.std, theirs.std)))
    error = abs(change) * highest
    sure = _probability(error, spread, len(splits) + len(references), valve.valves)
    if error <= LEAST_BIAS or sure < 1.0 - BY_CHANCE:
        return []
    words = f"The pressure in chamber {valve.chamber} is {1.0 + change:.2f} times "
    words += "what it was in nominal recordings." if references else "its set-point."
    quantity = {"gain": Quantity(change, spread / highest, "1")}
    return [_finding("chamber_gain", valve, words, quantity, sure, "pressure level")]


def _deadband(valve: ComparedValve, band: float, std: float, probability: float, *, seen: bool) -> Finding:
    """Report a dead band: seen where some set-point had no effect, else likelier than a bias."""
    rivals: tuple[Rival, ...] = ()
    words = f"The first {1e-3 * band:.2f} kPa of the set-point of chamber {valve.chamber} have no effect."
    if not seen:
        words = (
            f"The pressure in chamber {valve.chamber} stays {1e-3 * band:.2f} kPa further below its "
            "set-point than in nominal recordings."
        )
        rivals = (_alike("pressure_bias", valve.chamber, np.log(DEADBAND / (1.0 - DEADBAND))),)
        probability *= DEADBAND
    quantity = {"band": Quantity(band, std, "Pa")}
    return _finding("valve_deadband", valve, words, quantity, probability, "pressure level", rivals)


def _alike(effect: EffectName, chamber: int, log_bayes_factor: float) -> Rival:
    """Return an effect that a pressure too low while open, and right when vented, may be as well.

    Max(set-point - b, 0) is the law of a dead band and that of a negative bias.
    """
    return Rival(effect, Place(chamber=chamber), "a staircase of small pressures", float(log_bayes_factor))


def _vented_change(splits: Sequence[Split], references: Sequence[Split]) -> float:
    """Return what is read while valves are shut, over the same in nominal recordings, if there are any [Pa].

    It is 0 where either never shut them: what nobody saw has not changed.
    """
    read, before = (
        [split.valve.law.vented for split in group if split.valve.law.vents] for group in (splits, references)
    )
    if not read or (references and not before):
        return 0.0
    return float(np.mean(read)) - (float(np.mean(before)) if before else 0.0)


def _delays(valve: ComparedValve, jitter: float) -> list[Finding]:
    """Report a dead time and a lag, or by how much a valve has become later, or quicker."""
    splits, references = _timed(valve.splits), _timed(valve.references)
    if not splits or (valve.references and not references):
        return []
    dead, lag = (float(np.mean(values)) for values in _times(splits))
    dead_before, lag_before = (float(np.mean(values)) if references else 0.0 for values in _times(references))
    late, slower = dead - dead_before, lag - lag_before
    recordings = 1.0 / len(splits) + (1.0 / len(references) if references else 0.0)
    spread = jitter * float(np.sqrt(recordings))
    change = late + slower
    sure = _probability(abs(change), spread, len(splits) + len(references), valve.valves)
    if abs(change) <= LEAST_DELAY or sure < 1.0 - BY_CHANCE:
        return []
    deviation = max(spread, float(np.hypot(_timing_std(splits), _timing_std(references))))
    resolution = max(_jitter(split) for split in valve.splits)
    words = (
        f"The valve of chamber {valve.chamber} responds {1e3 * dead:.0f} ms after its set-point, and then "
        f"settles with a time constant of {1e3 * lag:.0f} ms"
    )
    words += f", {1e3 * change:+.0f} ms from nominal recordings." if references else "."
    quantities = {
        name: Quantity(value if abs(value) > resolution else 0.0, deviation, "s")
        for name, value in (("lag", slower), ("dead_time", late))
    }
    return [_finding("line_lag", valve, words, quantities, sure, "time since a change")]


def _spread(within: float, between: float, suspects: int, nominal: int) -> float:
    """Return how far the change of a steady error is uncertain [Pa].

    Args:
        within: Scatter between the holds of a recording.
        between: Scatter between recordings of one state.
        suspects: Number of recordings in question.
        nominal: Number of nominal recordings; without any, the error itself is asked for.
    """
    own = within / np.sqrt(suspects)
    other = between * np.sqrt(1.0 / suspects + 1.0 / nominal) if nominal else 0.0
    return max(float(np.hypot(own, other)), LEAST_STD)


def _probability(size: float, spread: float, recordings: int, valves: int = 1) -> float:
    """Return how probable it is that none of the valves shows as much by chance (Student; Sidak 1967).

    Args:
        size: What was found, positive.
        spread: Its standard deviation.
        recordings: Number of recordings that determine the deviation, beside what was known of it.
        valves: Number of valves that were looked at.
    """
    return float(stdtr(WORTH + recordings, size / max(spread, 1e-300))) ** valves


def _timed(splits: Sequence[Split]) -> list[Timing]:
    """Return the delays of valves that show them; a lag at the end of the grid is no lag."""
    timings = [split.valve.timing for split in splits if split.valve.timed]
    return [timing for timing in timings if timing.lag < LAGS[-1]]


def _offsets(splits: Sequence[Split]) -> list[float]:
    """Return the steady errors of valves that were held open [Pa], a dead band counted as one."""
    laws = [split.valve.law for split in splits if split.valve.law.holds]
    return [law.bias - (1.0 + law.gain.value) * law.deadband for law in laws]


def _timing_std(timings: Sequence[Timing]) -> float:
    """Return the standard deviation of the mean dead time, or lag, over recordings [s]."""
    squares = sum(timing.std**2 for timing in timings)
    return float(np.sqrt(squares)) / max(len(timings), 1)


def _times(timings: Sequence[Timing]) -> tuple[list[float], list[float]]:
    """Return dead times and lags [s]."""
    return [timing.dead_time for timing in timings], [timing.lag for timing in timings]


def _delayed(splits: Sequence[Split]) -> list[float]:
    """Return dead time and lag together [s]: what one gains the other loses."""
    return [timing.dead_time + timing.lag for timing in _timed(splits)]


def channel_error(pairs: Floats) -> ChannelError:
    """Pool the errors of set-point and of law [Pa], shape (recordings, 2)."""
    before, after = np.sqrt(np.mean(pairs**2, axis=0)).tolist()
    return ChannelError("Pa", before, after)


def gain_interval(splits: Sequence[Split]) -> tuple[float, float]:
    """Return the 95 % interval of 1 - after / before over recordings and valves; none of a single one."""
    if len(splits) < 2:
        return 0.0, 0.0
    squares = np.array([(np.array(split.errors()) / split.floor) ** 2 for split in splits])
    return bootstrap(np.random.default_rng(0), squares[:, 0], squares[:, 1])


def _evidence(splits: Sequence[Split]) -> Evidence:
    pairs = np.array([split.errors() for split in splits])
    noise = np.array([split.floor for split in splits])
    before, after = (float(np.sqrt(np.mean((column / noise) ** 2))) for column in pairs.T)
    # Samples of a valve's answer repeat the same information for about its settling time.
    effective = max(sum(split.unseen_seconds for split in splits) / SETTLED, 2.0)
    gain = effective * (before**2 - after**2) / max(after**2, 1.0)
    channel = {f"pressure_{splits[0].valve.chamber}": channel_error(pairs)}
    log_bayes_factor = gain / 2.0 - 2.0 * np.log(effective)
    return Evidence(log_bayes_factor, before, after, gain_interval(splits), float("nan"), channel)


def _finding(
    effect: EffectName,
    valve: ComparedValve,
    words: str,
    quantities: dict[str, Quantity],
    probability: float,
    when: str,
    rivals: tuple[Rival, ...] = (),
) -> Finding:
    shows = "Set-point and measured pressure show it, so it is in the valve or its sensor and not in the arm."
    place = Place(chamber=valve.chamber)
    return Finding(
        effect, place, when, f"{words} {shows}", quantities, valve.evidence, rivals, probability=probability
    )

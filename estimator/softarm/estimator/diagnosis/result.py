"""The result of a diagnosis: how far the model is off, where, which physics explains it, and what is left.

Residuals are measured minus predicted: metres for markers and positions, radians for rotations and bends,
pascals for the pressures behind the valves. Normalised residuals are divided by the noise of their channel.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.recording import Recording
from softarm.estimator.specimen.physics import EffectName, Place

Verdict = Literal["consistent", "explained", "partly_explained", "unexplained"]
CellKind = Literal["segment", "chamber", "sensor", "base"]
Regime = Literal[
    "constant",
    "pressure level",
    "direction of change",
    "time since a change",
    "rate",
    "pose",
    "largest strain so far",
    "time of the run",
]


@dataclass(frozen=True)
class Baseline:
    """The calibrated model without any effect, on the recordings in question.

    Args:
        rms: Root mean square of the residual of each channel, in the channel's unit.
        noise_floor: What noise and repeatability alone would leave in it.
        units: Unit of each channel: ``m``, ``rad`` or ``Pa``.
        normalised_rms: Root mean square of all residuals over their floors; 1 where nothing is missing.
    """

    rms: Mapping[str, float]
    noise_floor: Mapping[str, float]
    units: Mapping[str, str]
    normalised_rms: float


@dataclass(frozen=True)
class Cell:
    """One place of the map and the regime in which the mismatch shows there.

    Args:
        kind: Sort of place.
        name: Segment or sensor, or the chamber's index as text; ``base`` for the base.
        axis: ``x``, ``y`` (bending), ``z`` (torsion), ``axial``, ``pressure``, or the sensor's channel.
        regime: What the equivalent load varies with.
        amplitude: Root mean square of the equivalent load or offset that would remove it, in ``unit``.
        unit: ``N m``, ``N``, ``Pa``, ``m`` or ``rad``.
        share: Share of the mismatch beyond noise that this cell alone removes, 0 to 1.
        p_value: Chance of such a share anywhere in the map without any mismatch.
    """

    kind: CellKind
    name: str
    axis: str
    regime: Regime
    amplitude: float
    unit: str
    share: float
    p_value: float

    @property
    def place(self) -> Place:
        """The place in the vocabulary of effects; the base is the section ``base``."""
        if self.kind == "segment":
            return Place(segment=self.name, axis=self.axis)
        if self.kind == "chamber":
            return Place(chamber=int(self.name))
        if self.kind == "sensor":
            return Place(sensor=self.name, axis=self.axis)
        return Place(section=self.name, axis=self.axis)


@dataclass(frozen=True)
class LocationMap:
    """Where the mismatch sits along the arm and what it varies with, before any hypothesis.

    Args:
        cells: Every place and regime that was tried, the largest share first.
    """

    cells: tuple[Cell, ...] = ()

    @property
    def best(self) -> Cell | None:
        """The cell that removes most, where there is any."""
        return self.cells[0] if self.cells else None

    def by_place(self) -> dict[tuple[CellKind, str], float]:
        """Return the largest share at each place, for colouring the arm."""
        shares: dict[tuple[CellKind, str], float] = {}
        for cell in self.cells:
            key = (cell.kind, cell.name)
            shares[key] = max(shares.get(key, 0.0), cell.share)
        return shares


@dataclass(frozen=True)
class Trace:
    """One channel of one recording over time, as a picture shows it.

    Args:
        recording: Name of the recording.
        channel: Name of the channel, such as ``bend_tip.x``.
        unit: ``m``, ``rad`` or ``Pa``.
        time: Seconds, shape (samples,).
        measured: Reading, NaN where lost, shape (samples,).
        before: Prediction of the calibrated model, shape (samples,).
        after: Prediction with all findings, shape (samples,).
        heldout: Samples that no fit and no choice has seen, shape (samples,).
    """

    recording: str
    channel: str
    unit: str
    time: Floats
    measured: Floats
    before: Floats
    after: Floats
    heldout: Flags


@dataclass(frozen=True)
class Exposure:
    """The residual against the variable that exposes a finding.

    Args:
        variable: Name of the variable, such as ``pressure of chamber 2``.
        channel: Channel whose residual is shown, the one that the finding improves most.
        channel_unit: Unit of the residual.
        values: The variable, shape (samples,).
        before: Residual without the finding (all others kept), shape (samples,).
        after: Residual with it, shape (samples,).
    """

    variable: str
    unit: str
    channel: str
    channel_unit: str
    values: Floats
    before: Floats
    after: Floats


@dataclass(frozen=True)
class ChannelError:
    """Error of one channel on data that no fit and no choice has seen, in the channel's unit.

    Args:
        unit: ``m``, ``rad`` or ``Pa``.
        before: Root mean square of the residual without what is judged.
        after: The same with it.
        line: The same of a linear regression on the pressures; ``None`` where a line cannot predict it.
    """

    unit: str
    before: float
    after: float
    line: float | None = None


ChannelErrors = Mapping[str, ChannelError]


@dataclass(frozen=True)
class InnovationTest:
    """Whether held-out data are white noise of the assumed size, once their own past has been used.

    Args:
        variance: Mean square of the standardised innovations of each channel: what a process with the memory
            that other stretches show does not predict from the past; 1 where it is as large as there.
        correlation: Their correlation between neighbouring samples; 0 where they are white.
        chance: Of as much correlation as they show (Ljung and Box), where they are white.
        residual_variance: Mean square of the residuals themselves, over the standard deviation that the
            choice assumed.
        residual_correlation: Their correlation between neighbouring samples.
    """

    variance: Mapping[str, float] = field(default_factory=dict)
    correlation: Mapping[str, float] = field(default_factory=dict)
    chance: Mapping[str, float] = field(default_factory=dict)
    residual_variance: Mapping[str, float] = field(default_factory=dict)
    residual_correlation: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Stretch:
    """A stretch of time in which a channel is off.

    Args:
        recording: Name of the recording.
        channel: Name of the channel.
        unit: Its unit: ``m``, ``rad`` or ``Pa``.
        start: When it begins, by the recording's own times [s].
        end: When it ends.
        rms: Root mean square of the residual in it, in ``unit``.
    """

    recording: str
    channel: str
    unit: str
    start: float
    end: float
    rms: float


@dataclass(frozen=True)
class Quantity:
    """A parameter with its standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Evidence:
    """Why a finding is believed.

    Args:
        log_bayes_factor: Natural logarithm of the Bayes factor against the model without it, as half the gain
            of the Bayesian information criterion with the effective number of samples (Schwarz 1978; Kass and
            Raftery, J. Am. Stat. Assoc. 90 (1995) 773, section 4.1.3).
        heldout_before: Normalised rms on held-out data without the finding, all others kept.
        heldout_after: The same with it.
        heldout_gain_ci95: Bootstrap interval over blocks of the relative gain 1 - after / before.
        search_p: Chance that the whole search finds as much where nothing is missing.
        channels: Error of each channel without the finding, all others kept, and with it.
    """

    log_bayes_factor: float
    heldout_before: float
    heldout_after: float
    heldout_gain_ci95: tuple[float, float]
    search_p: float
    channels: ChannelErrors = field(default_factory=dict)


@dataclass(frozen=True)
class Rival:
    """An effect that these data cannot distinguish from a finding.

    Args:
        effect: Its name.
        where: Where it would act.
        manoeuvre: What would distinguish the two, in words.
        log_bayes_factor: Natural logarithm of the Bayes factor of the finding against it.
    """

    effect: EffectName
    where: Place
    manoeuvre: str
    log_bayes_factor: float


@dataclass(frozen=True)
class Rejected:
    """An alternative that lost against a finding, and the logarithm of the Bayes factor between them."""

    effect: EffectName
    where: Place
    log_bayes_factor: float


@dataclass(frozen=True)
class Finding:
    """Physics that was left out.

    Args:
        effect: Name in the vocabulary.
        where: Where it acts.
        when: What it depends on.
        statement: One plain paragraph.
        parameters: Its parameters by name.
        evidence: Why it is believed.
        confusable_with: What these data cannot distinguish from it.
        rejected: What lost, the closest first.
        exposure: The residual against the variable that exposes it, where there is one.
        probability: Posterior probability that it acts at this place; ``None`` where none was computed.
        interval: From when to when [s], of an ``event`` alone.
        recording: In which recording, of an ``event`` alone.
    """

    effect: EffectName
    where: Place
    when: str
    statement: str
    parameters: Mapping[str, Quantity]
    evidence: Evidence
    confusable_with: tuple[Rival, ...] = ()
    rejected: tuple[Rejected, ...] = ()
    exposure: Exposure | None = None
    probability: float | None = None
    interval: tuple[float, float] | None = None
    recording: str | None = None


@dataclass(frozen=True)
class Heldout:
    """How well data are predicted that no fit and no choice has seen.

    Args:
        before: Normalised rms of the calibrated model.
        after: With all findings.
        gain_ci95: Bootstrap interval over blocks of 1 - after / before.
        how_split: In words, which data these are.
        channels: Error of each channel before and after.
        innovations: Whether what is left is noise.
    """

    before: float
    after: float
    gain_ci95: tuple[float, float]
    how_split: str
    channels: ChannelErrors = field(default_factory=dict)
    innovations: InnovationTest = field(default_factory=InnovationTest)


@dataclass(frozen=True)
class Unexplained:
    """What is left.

    Args:
        normalised_rms: Of the held-out residuals with all findings.
        where: Where most of it sits, empty where nothing significant is left.
        when: What it varies with, empty likewise.
        map: The location map of what is left.
        over_nominal: What no known effect explains, as a multiple of the same in nominal recordings; ``None``
            where there are none.
        worst: The stretch and channel with the largest error that is left, over noise.
    """

    normalised_rms: float
    where: Place = field(default_factory=Place)
    when: str = ""
    map: LocationMap = LocationMap()
    over_nominal: float | None = None
    worst: Stretch | None = None


@dataclass(frozen=True)
class NotTestable:
    """An effect that the recordings cannot show.

    Args:
        effect: Its name.
        missing: What it needs and they lack, in words.
    """

    effect: EffectName
    missing: str


@dataclass(frozen=True)
class DetectionLimit:
    """The least size of an effect that nine of ten such recordings would show, to first order.

    Args:
        effect: Its name.
        where: Where it acts.
        parameter: Which of its amplitudes.
    """

    effect: EffectName
    where: Place
    parameter: str
    size: float
    unit: str


@dataclass(frozen=True)
class Diagnosis:
    """The whole result.

    Args:
        specimen: Name of the specimen.
        recordings: Names of the recordings that were diagnosed.
        nominal: Names of the recordings of the arm in its known state.
        verdict: In one word.
        baseline: How far the calibrated model is off.
        map: Where, before any hypothesis.
        findings: What was left out, the most important first.
        heldout: How much better the model predicts.
        unexplained: What is left.
        not_testable: What these recordings could not have shown.
        detection_limits: How large each effect would have to be to be found.
        notes: Plain sentences on the data and on the way: gaps, clocks, what was decimated, what was assumed.
        traces: Channels before and after.
        motions: The recordings that were diagnosed, in their order; see ``motion.py``.
        seconds: How long it took.
    """

    specimen: str
    recordings: tuple[str, ...]
    nominal: tuple[str, ...]
    verdict: Verdict
    baseline: Baseline
    map: LocationMap
    findings: tuple[Finding, ...]
    heldout: Heldout
    unexplained: Unexplained
    not_testable: tuple[NotTestable, ...] = ()
    detection_limits: tuple[DetectionLimit, ...] = ()
    notes: tuple[str, ...] = ()
    traces: tuple[Trace, ...] = field(default=(), repr=False)
    motions: tuple[Recording, ...] = field(default=(), repr=False)
    seconds: float = 0.0

    def with_faults(self, faults: tuple[Finding, ...]) -> "Diagnosis":
        """Add what valves and sensors do of themselves to the diagnosis of an arm."""
        if not faults:
            return self
        verdict: Verdict = "explained" if self.verdict == "consistent" else self.verdict
        if self.verdict == "unexplained":
            verdict = "partly_explained"
        return replace(self, verdict=verdict, findings=(*self.findings, *faults))

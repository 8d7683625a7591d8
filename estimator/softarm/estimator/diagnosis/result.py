"""What a diagnosis says: how far the model is off, where, which physics explains it, and what is left.

Residuals are measured minus predicted: metres for markers and positions, radians for rotations and bends,
pascals for the pressures behind the valves. Normalised residuals are divided by the noise of their channel.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.specimen.physics import EffectName, Place

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

Verdict = Literal["consistent", "explained", "partly_explained", "unexplained"]
CellKind = Literal["segment", "chamber", "section", "sensor", "base"]
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
        name: Segment, section or sensor, or the chamber's index as text; ``base`` for the base.
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
        """Give the largest share at each place, for colouring the arm."""
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
        unit: Its unit.
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
class Quantity:
    """A parameter with its standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Evidence:
    """Why a finding is believed.

    Args:
        delta_bic: Gain of the Bayesian information criterion over the model without it, with the effective
            number of samples.
        heldout_before: Normalised rms on held-out data without the finding, all others kept.
        heldout_after: The same with it.
        heldout_gain_ci95: Bootstrap interval over blocks of the relative gain 1 - after / before.
        search_p: Chance that the whole search finds as much where nothing is missing.
    """

    delta_bic: float
    heldout_before: float
    heldout_after: float
    heldout_gain_ci95: tuple[float, float]
    search_p: float


@dataclass(frozen=True)
class Rival:
    """An effect that these data cannot tell from a finding.

    Args:
        effect: Its name.
        where: Where it would act.
        manoeuvre: What would tell the two apart, in words.
        delta_bic: By how much it lost against the finding.
    """

    effect: EffectName
    where: Place
    manoeuvre: str
    delta_bic: float


@dataclass(frozen=True)
class Rejected:
    """An alternative that lost against a finding, by how much."""

    effect: EffectName
    where: Place
    delta_bic: float


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
        confusable_with: What these data cannot tell from it.
        rejected: What lost, the closest first.
        exposure: The residual against the variable that exposes it, where there is one.
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


@dataclass(frozen=True)
class Heldout:
    """How well data are predicted that no fit and no choice has seen.

    Args:
        before: Normalised rms of the calibrated model.
        after: With all findings.
        gain_ci95: Bootstrap interval over blocks of 1 - after / before.
        how_split: In words, which data these are.
    """

    before: float
    after: float
    gain_ci95: tuple[float, float]
    how_split: str


@dataclass(frozen=True)
class Unexplained:
    """What is left.

    Args:
        normalised_rms: Of the held-out residuals with all findings.
        where: Where most of it sits, empty where nothing significant is left.
        when: What it varies with, empty likewise.
        map: The location map of what is left.
    """

    normalised_rms: float
    where: Place = field(default_factory=Place)
    when: str = ""
    map: LocationMap = LocationMap()


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
        notes: Plain sentences on the data and on the way: gaps, clocks, what was decimated, what was assumed.
        traces: Channels before and after.
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
    notes: tuple[str, ...] = ()
    traces: tuple[Trace, ...] = field(default=(), repr=False)
    seconds: float = 0.0

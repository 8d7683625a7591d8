"""``report.json``: a diagnosis as the contract writes it down, checked when written and when read."""

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from softarm.analysis.diagnosis.sentences import is_white
from softarm.estimator.diagnosis.result import Diagnosis, Finding
from softarm.estimator.effects.amounts import readable
from softarm.estimator.errors import InputError
from softarm.estimator.specimen.physics import EffectName, Place

SCHEMA: Literal["softarm.diagnosis/1"] = "softarm.diagnosis/1"
FILE = "report.json"

Number = Annotated[float, Field(allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Unit = Literal["deg", "mm", "kPa"]
UNITS: dict[str, Unit] = {"rad": "deg", "m": "mm", "Pa": "kPa"}


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Where(_Part):
    """Where an effect acts; null where it does not apply."""

    segment: str | None = None
    chamber: int | None = None
    section: str | None = None
    sensor: str | None = None
    axis: str | None = None

    @property
    def place(self) -> Place:
        """The same in the vocabulary of effects."""
        return Place(**self.model_dump())


class BaselinePart(_Part):
    """The calibrated model without any effect."""

    rms: dict[str, Number]
    noise_floor: dict[str, Number]
    normalised_rms: Number


class ParameterPart(_Part):
    """A parameter of an effect."""

    value: Number
    std: Number
    unit: str


class EvidencePart(_Part):
    """Why a finding is believed; the Bayes factor as its natural logarithm."""

    log_bayes_factor: Number
    heldout_before: Number
    heldout_after: Number
    heldout_gain_ci95: tuple[Number, Number]


class ConfusablePart(_Part):
    """What these data cannot distinguish from a finding, and the manoeuvre that would."""

    effect: EffectName
    where: Where
    manoeuvre: str


class RejectedPart(_Part):
    """An alternative that lost, and by how much."""

    effect: EffectName
    log_bayes_factor: Number


class FindingPart(_Part):
    """Physics that was left out."""

    effect: EffectName
    where: Where
    when: str
    statement: str
    parameters: dict[str, ParameterPart]
    probability: Probability | None
    interval: tuple[Number, Number] | None
    recording: str | None
    evidence: EvidencePart
    confusable_with: list[ConfusablePart]
    rejected: list[RejectedPart]


class HeldoutPart(_Part):
    """Prediction of data that no fit and no choice has seen."""

    rms_before: dict[str, Number]
    rms_after: dict[str, Number]
    rms_linear_regression: dict[str, Number] = Field(default_factory=dict)
    unit: dict[str, Unit]
    normalised_rms_before: Number
    normalised_rms_after: Number
    gain_ci95: tuple[Number, Number]
    how_split: str


class NoisePart(_Part):
    """Standardised innovations and residuals of held-out data: 1 and 0 where they are white and as learnt.

    Innovations are what a channel's own past does not predict, by a process that other stretches show; their
    chance is that of as much correlation in white noise.
    """

    white: bool = False
    innovation_variance: dict[str, Number]
    innovation_correlation: dict[str, Number]
    innovation_chance: dict[str, Probability] = Field(default_factory=dict)
    residual_variance: dict[str, Number] = Field(default_factory=dict)
    residual_correlation: dict[str, Number] = Field(default_factory=dict)


class LimitPart(_Part):
    """How large an effect would have to be at a place to be found in nine of ten such recordings."""

    effect: EffectName
    where: Where
    parameter: str
    size: Number
    unit: str


class UnexplainedPart(_Part):
    """What is left."""

    normalised_rms: Number
    where: Where
    when: str


class Report(_Part):
    """A diagnosis."""

    schema_: Literal["softarm.diagnosis/1"] = Field(SCHEMA, alias="schema")
    specimen: str
    recordings: list[str]
    verdict: Literal["consistent", "explained", "partly_explained", "unexplained"]
    baseline: BaselinePart
    findings: list[FindingPart]
    heldout: HeldoutPart
    calibration_of_noise: NoisePart
    unexplained: UnexplainedPart
    detection_limits: list[LimitPart]

    def dump(self) -> str:
        """Return the text of ``report.json``."""
        return json.dumps(self.model_dump(by_alias=True, mode="json"), indent=2) + "\n"


def report_of(diagnosis: Diagnosis) -> Report:
    """Write a diagnosis down."""
    heldout, left = diagnosis.heldout, diagnosis.unexplained
    return Report(
        schema=SCHEMA,
        specimen=diagnosis.specimen,
        recordings=list(diagnosis.recordings),
        verdict=diagnosis.verdict,
        baseline=BaselinePart(
            rms=dict(diagnosis.baseline.rms),
            noise_floor=dict(diagnosis.baseline.noise_floor),
            normalised_rms=diagnosis.baseline.normalised_rms,
        ),
        findings=[_finding(finding) for finding in diagnosis.findings],
        heldout=HeldoutPart(
            rms_before={name: readable(one.unit)[0] * one.before for name, one in heldout.channels.items()},
            rms_after={name: readable(one.unit)[0] * one.after for name, one in heldout.channels.items()},
            rms_linear_regression={
                name: readable(one.unit)[0] * one.line
                for name, one in heldout.channels.items()
                if one.line is not None
            },
            unit={name: UNITS[one.unit] for name, one in heldout.channels.items()},
            normalised_rms_before=heldout.before,
            normalised_rms_after=heldout.after,
            gain_ci95=heldout.gain_ci95,
            how_split=heldout.how_split,
        ),
        calibration_of_noise=NoisePart(
            white=is_white(heldout.innovations),
            innovation_variance=dict(heldout.innovations.variance),
            innovation_correlation=dict(heldout.innovations.correlation),
            innovation_chance=dict(heldout.innovations.chance),
            residual_variance=dict(heldout.innovations.residual_variance),
            residual_correlation=dict(heldout.innovations.residual_correlation),
        ),
        unexplained=UnexplainedPart(
            normalised_rms=left.normalised_rms, where=_where(left.where), when=left.when
        ),
        detection_limits=[
            LimitPart(
                effect=one.effect,
                where=_where(one.where),
                parameter=one.parameter,
                size=one.size,
                unit=one.unit,
            )
            for one in diagnosis.detection_limits
        ],
    )


def read_report(path: Path) -> Report:
    """Read and check a report; ``path`` is the file or its folder.

    Raises:
        InputError: It is absent or is no report.
    """
    file = path / FILE if path.is_dir() else path
    try:
        return Report.model_validate_json(file.read_bytes())
    except OSError:
        raise InputError(str(file), "there is no such report", "give the --out of softarm diagnose") from None
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"]))
        raise InputError(f"{file}, {field}", first["msg"], "write it again with softarm diagnose") from None


def _where(place: Place) -> Where:
    return Where(**place.model_dump())


def _finding(finding: Finding) -> FindingPart:
    evidence = finding.evidence
    return FindingPart(
        effect=finding.effect,
        where=_where(finding.where),
        when=finding.when,
        statement=finding.statement,
        parameters={
            name: ParameterPart(value=q.value, std=q.std, unit=q.unit)
            for name, q in finding.parameters.items()
        },
        probability=finding.probability,
        interval=finding.interval,
        recording=finding.recording,
        evidence=EvidencePart(
            log_bayes_factor=evidence.log_bayes_factor,
            heldout_before=evidence.heldout_before,
            heldout_after=evidence.heldout_after,
            heldout_gain_ci95=evidence.heldout_gain_ci95,
        ),
        confusable_with=[
            ConfusablePart(effect=rival.effect, where=_where(rival.where), manoeuvre=rival.manoeuvre)
            for rival in finding.confusable_with
        ],
        rejected=[
            RejectedPart(effect=r.effect, log_bayes_factor=r.log_bayes_factor) for r in finding.rejected
        ],
    )

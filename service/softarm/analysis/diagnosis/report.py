"""``report.json``: a diagnosis as the contract writes it down, checked when written and when read."""

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from softarm.analysis.diagnosis.sentences import is_white
from softarm.estimator.diagnosis.result import Diagnosis
from softarm.estimator.effects.amounts import readable
from softarm.estimator.errors import InputError
from softarm.estimator.specimen.physics import EffectName, Place

SCHEMA: Literal["softarm.diagnosis/1"] = "softarm.diagnosis/1"
FILE = "report.json"

Number = Annotated[float, Field(allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Unit = Literal["deg", "mm"]
UNITS: dict[str, Unit] = {"rad": "deg", "m": "mm"}


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, from_attributes=True)


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
    where: Place
    manoeuvre: str


class RejectedPart(_Part):
    """An alternative that lost, and by how much."""

    effect: EffectName
    log_bayes_factor: Number


class FindingPart(_Part):
    """Physics that was left out."""

    effect: EffectName
    where: Place
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
    """Prediction of data that no fit and no choice has seen.

    Args:
        pressure_rms_pa: Errors of set-point and of the valve's law, where only valves were recorded.
    """

    rms_before: dict[str, Number]
    rms_after: dict[str, Number]
    rms_linear_regression: dict[str, Number] = Field(default_factory=dict)
    unit: dict[str, Unit]
    pressure_rms_pa: dict[str, tuple[Number, Number]] = Field(default_factory=dict)
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
    where: Place
    parameter: str
    size: Number
    unit: str


class UnexplainedPart(_Part):
    """What is left."""

    normalised_rms: Number
    where: Place
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
    heldout, test = diagnosis.heldout, diagnosis.heldout.innovations
    channels = {name: one for name, one in heldout.channels.items() if one.unit in UNITS}
    shown = {unit: readable(unit)[0] for unit in UNITS}
    return Report(
        schema=SCHEMA,
        specimen=diagnosis.specimen,
        recordings=list(diagnosis.recordings),
        verdict=diagnosis.verdict,
        baseline=BaselinePart.model_validate(diagnosis.baseline),
        findings=[FindingPart.model_validate(finding) for finding in diagnosis.findings],
        heldout=HeldoutPart(
            rms_before={name: shown[one.unit] * one.before for name, one in channels.items()},
            rms_after={name: shown[one.unit] * one.after for name, one in channels.items()},
            rms_linear_regression={
                name: shown[one.unit] * one.line for name, one in channels.items() if one.line is not None
            },
            unit={name: UNITS[one.unit] for name, one in channels.items()},
            pressure_rms_pa={
                name: (one.before, one.after) for name, one in heldout.channels.items() if one.unit == "Pa"
            },
            normalised_rms_before=heldout.before,
            normalised_rms_after=heldout.after,
            gain_ci95=heldout.gain_ci95,
            how_split=heldout.how_split,
        ),
        calibration_of_noise=NoisePart(
            white=is_white(test),
            innovation_variance=dict(test.variance),
            innovation_correlation=dict(test.correlation),
            innovation_chance=dict(test.chance),
            residual_variance=dict(test.residual_variance),
            residual_correlation=dict(test.residual_correlation),
        ),
        unexplained=UnexplainedPart.model_validate(diagnosis.unexplained),
        detection_limits=[LimitPart.model_validate(one) for one in diagnosis.detection_limits],
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

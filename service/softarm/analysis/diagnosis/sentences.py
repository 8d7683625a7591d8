"""A diagnosis in sentences: each states only what the numbers in it show. Page and terminal share them."""

from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np

from softarm.estimator.diagnosis.result import (
    ChannelError,
    ChannelErrors,
    Diagnosis,
    Finding,
    InnovationTest,
    Quantity,
    Stretch,
)
from softarm.estimator.diagnosis.words import dependence, plain
from softarm.estimator.effects.amounts import readable
from softarm.estimator.effects.effect import describe
from softarm.estimator.specimen.physics import EffectName, Place

NEAR_NOISE = 1.5
"""Multiple of the noise up to which an error counts as down to the noise."""
HARDLY = 0.01
"""Share of an error, of every channel and of all together, below which a change of it is none."""
STRENGTHS = ((2.0, "decisive"), (1.0, "strong"), (0.5, "substantial"), (0.0, "weak"), (-np.inf, "none"))
"""Least decimal logarithm of a Bayes factor and its name: Kass and Raftery, J. Am. Stat. Assoc. 90 (1995),
section 3.2, who call "weak" what is "not worth more than a bare mention"."""
OF_THE_ARM = {
    "segment_stiffness",
    "local_stiffness_defect",
    "material_softening",
    "material_stiffening",
    "chamber_gain",
    "tip_payload",
}
"""Effects that change where the arm rests. Their detection limits are stated as far as their bounds."""
LEFT_OUT = {
    "sensor_stuck": "what the sensor reads meanwhile is not used",
    "event": "what was read meanwhile is not used",
    "frame_mismatch": "the recording was converted before anything else",
}
"""Findings that are corrected or left out before any fit, so that they remove no error of the model."""
WHITE_VARIANCE = (0.5, 2.0)
WHITE_CORRELATION = 0.3
"""Variance and correlation of innovations between which they are called white noise of the estimated size."""


def number(value: float) -> str:
    """Write a number with three digits and without an exponent."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{float(f'{value:.3g}'):g}"


def amount(value: float, unit: str) -> str:
    """Write a value in an SI unit in the unit in which people read it."""
    factor, name = readable(unit)
    return f"{number(factor * value)} {name}".strip()


def quantity(one: Quantity) -> str:
    """Write a parameter with its standard deviation, where it has one."""
    factor, name = readable(one.unit)
    deviation = f" ± {factor * one.std:.2g}" if one.std else ""
    return f"{factor * one.value:.4g}{deviation} {name}".strip()


class Located(Protocol):
    """An effect at a place: a finding or a rival, of a diagnosis or of its report."""

    @property
    def effect(self) -> EffectName:
        """Its name."""
        ...

    @property
    def where(self) -> Place:
        """Where it acts."""
        ...


def place(one: Located) -> str:
    """Name an effect and its place."""
    return f"{plain(one.effect)}, {describe(one.where)}"


def strength(log_bayes_factor: float) -> str:
    """Name the strength of evidence of a Bayes factor, given by its natural logarithm."""
    decimal = log_bayes_factor / np.log(10.0)
    return next(name for least, name in STRENGTHS if decimal >= least)


def evidence(log_bayes_factor: float) -> str:
    """Write the strength of evidence and the Bayes factor behind it."""
    return f"{strength(log_bayes_factor)} (ln B = {number(log_bayes_factor)})"


def by_unit(channels: ChannelErrors) -> dict[str, tuple[float, float]]:
    """Pool the errors before and after over the channels of each SI unit."""
    pooled = {}
    for unit in sorted({one.unit for one in channels.values()}):
        own = [one for one in channels.values() if one.unit == unit]
        before, after = (_rms([getattr(one, which) for one in own]) for which in ("before", "after"))
        pooled[unit] = (before, after)
    return pooled


def physical(channels: ChannelErrors) -> str:
    """Write the pooled errors before and after: ``from 2.3 to 0.9 degrees and from 14 to 3 mm``."""
    parts = []
    for unit, (before, after) in by_unit(channels).items():
        factor, name = readable(unit)
        parts.append(f"from {number(factor * before)} to {number(factor * after)} {name}")
    return " and ".join(parts)


def headline(diagnosis: Diagnosis) -> str:
    """Name the verdict, and that unseen data contradict it where they do."""
    name = plain(diagnosis.verdict)
    return f"{name}, but not confirmed" if _contradicted(diagnosis) else name


def _contradicted(diagnosis: Diagnosis) -> bool:
    """Return whether findings make the error on unseen data larger, by what is printed of it."""
    heldout = diagnosis.heldout
    rises = heldout.after > heldout.before and number(heldout.after) != number(heldout.before)
    return bool(diagnosis.findings) and diagnosis.verdict != "unexplained" and rises


def verdict(diagnosis: Diagnosis) -> str:
    """Return the verdict in sentences that are true of the numbers in them."""
    heldout, unexplained = diagnosis.heldout, diagnosis.unexplained
    if not heldout.channels:
        return _unchecked(diagnosis)
    after = f"{number(heldout.after)} times the noise"
    fall = f"falls from {number(heldout.before)} to {after}"
    nameless_share = (
        " The part of it that no known effects explain, however combined, is "
        f"{number(unexplained.over_nominal)} times the same part in the recordings in the known state."
        if unexplained.over_nominal is not None
        else ""
    )
    if diagnosis.verdict == "consistent":
        opening = (
            "The findings below show in the readings themselves. Apart from them, "
            if diagnosis.findings
            else ""
        )
        if heldout.after <= NEAR_NOISE:
            agrees = f"{'the' if opening else 'The'} model agrees with the recordings"
            return f"{opening}{agrees}: the error on unseen data is {after}.{insensitivity_note(diagnosis)}"
        missing = f"{'no' if opening else 'No'} missing physics was found"
        return (
            f"{opening}{missing}. The error on unseen data is {after}, so a change that is smaller "
            f"than this error of the model would not show.{nameless_share}{insensitivity_note(diagnosis)}"
        )
    if diagnosis.verdict == "unexplained":
        return f"{unnamed_physics(diagnosis)}: the error on unseen data is {after}.{nameless_share}"
    if number(heldout.after) == number(heldout.before):
        stays = f"The error of the model on unseen data stays at {after}."
        if any(finding.effect == "unknown" for finding in diagnosis.findings):
            others = "The other findings below show in the readings themselves."
            return f"{unnamed_physics(diagnosis)}. {others} {stays}"
        return f"The findings below show in the readings themselves. {stays}"
    if _contradicted(diagnosis):
        return (
            "The data from which the findings below were chosen support them, but those kept for this "
            f"report do not: there the error rises from {number(heldout.before)} to {after}. The findings "
            "are doubtful until more recordings confirm them."
        )
    if diagnosis.verdict == "partly_explained":
        return (
            "The model is missing physics. The findings below explain part of the mismatch: the error on "
            f"unseen data {fall}, and the residual still has structure.{nameless_share}"
        )
    if heldout.after <= NEAR_NOISE:
        return (
            "The model was missing physics. The findings below explain the mismatch down to the noise: the "
            f"error on unseen data {fall}."
        )
    return (
        "The model was missing physics. The findings below explain the mismatch, but not down to the noise: "
        f"the error on unseen data {fall}.{nameless_share}"
    )


def insensitivity_note(diagnosis: Diagnosis) -> str:
    """Write that no change of the arm itself could have shown; empty where one could, or of valves alone."""
    units = {one.unit for one in diagnosis.heldout.channels.values()}
    if units <= {"Pa"} or any(one.effect in OF_THE_ARM for one in diagnosis.detection_limits):
        return ""
    return (
        " However, no change of the arm's stiffness or of a chamber's gain, and no payload, would have "
        "shown in these recordings, whatever its size."
    )


def unnamed_physics(diagnosis: Diagnosis) -> str:
    """Write that something is missing, and why it has no name."""
    unknown = [finding for finding in diagnosis.findings if finding.effect == "unknown"]
    rivals = max((len(one.confusable_with) for one in unknown if one.probability is None), default=0)
    if rivals == 1:
        return "The model is missing physics that these recordings show in too few poses to name it"
    if rivals:
        return "The model is missing physics for which these recordings leave several names open"
    return "The model is missing physics that no known effect explains"


def _unchecked(diagnosis: Diagnosis) -> str:
    """Return the verdict where no data were left unseen."""
    unseen = "The recordings leave no unseen data, so no error on such data is stated."
    if diagnosis.verdict == "consistent":
        return f"No missing physics was found. {unseen}"
    if diagnosis.verdict == "unexplained":
        return f"{unnamed_physics(diagnosis)}. {unseen}"
    return f"The model is missing physics, of which the findings below are known. {unseen}"


def gain(before: float, after: float, interval: tuple[float, float]) -> str:
    """Write a relative fall of an error with its interval."""
    if after >= before:
        return "The error on unseen data does not fall."
    low, high = (100.0 * bound for bound in interval)
    whole = 100.0 * (1.0 - after / max(before, 1e-12))
    falls = "The error on unseen data falls by"
    if low == high:
        return f"{falls} {whole:.0f} % (too few stretches of unseen data for an interval)."
    digits = next((d for d in (0, 1) if f"{low:.{d}f}" != f"{high:.{d}f}"), 2)
    spread = f"95 % interval over stretches of time: {low:.{digits}f} to {high:.{digits}f} %"
    return f"{falls} {whole:.{digits}f} % ({spread})."


def share(finding: Finding, diagnosis: Diagnosis) -> float:
    """Return the share of the error before any finding that is back when this finding alone is left out."""
    own = finding.evidence
    whole = max(diagnosis.heldout.before, own.heldout_before, 1e-12)
    return max(own.heldout_before - own.heldout_after, 0.0) / whole


def most_changed(channels: ChannelErrors) -> tuple[str, ChannelError] | None:
    """Return the channel whose error a finding lowers by the largest factor, with its name."""
    if not channels:
        return None
    name = max(channels, key=lambda one: channels[one].before / max(channels[one].after, 1e-15))
    return name, channels[name]


def effect_on_error(finding: Finding, diagnosis: Diagnosis) -> str:
    """Write what a finding does to the error on unseen data, in physical units and over the noise."""
    if finding.effect in LEFT_OUT:
        return f"For this finding, {LEFT_OUT[finding.effect]}."
    own = finding.evidence
    ratio = f"{number(own.heldout_before)} instead of {number(own.heldout_after)} times the noise"
    best = most_changed(own.channels)
    channel = ""
    if best is not None and not acts_elsewhere(finding):
        factor, unit = readable(best[1].unit)
        before, after = number(factor * best[1].before), number(factor * best[1].after)
        channel = f" In {best[0]}, which it changes most, it would be {before} instead of {after} {unit}."
    return (
        f"Without this finding, and with all others, the error on unseen data would be {ratio}: the finding "
        f"removes {removed(finding, diagnosis)}.{channel}"
    )


def evidence_sentence(finding: Finding) -> str:
    """Write how strong the evidence for a finding is."""
    own = finding.evidence
    words = f"The evidence for it is {evidence(own.log_bayes_factor)}."
    if finding.probability is not None:
        what = "no known effect explains it" if finding.effect == "unknown" else "it acts there"
        if is_valve(finding):
            what = "the valve errs in this direction and by this law"
        words += f" The probability that {what} is {100.0 * finding.probability:.0f} %."
    return words


def is_white(test: InnovationTest) -> bool:
    """Return whether the innovations of all channels are white noise of the estimated size."""
    sized = all(WHITE_VARIANCE[0] <= value <= WHITE_VARIANCE[1] for value in test.variance.values())
    alike = all(abs(value) <= WHITE_CORRELATION for value in test.correlation.values())
    return bool(test.variance) and sized and alike


def noise(test: InnovationTest) -> str:
    """Write whether what is left is white noise of the estimated size, itself and once its past is used."""
    if not test.variance:
        return "The residual was not tested for whiteness."
    verb = "is" if is_white(test) else "is not"
    words = (
        f"The residual {verb} white noise of the estimated size once each channel's own past is used: over "
        f"channels, {_spans(test.variance, test.correlation)}."
    )
    if not is_white(test):
        words += " Standard deviations may be too small."
    residuals = _spans(test.residual_variance, test.residual_correlation)
    return (
        f"{words} Of the residuals themselves, {residuals}: the standard deviations of sizes allow for that."
    )


def _spans(variance: Mapping[str, float], correlation: Mapping[str, float]) -> str:
    """Write over which range the variance and the correlation of standardised values lie."""
    sizes, alike = variance.values(), correlation.values()
    return (
        f"the variance lies between {number(min(sizes))} and {number(max(sizes))} (1 expected), the "
        f"correlation of neighbouring samples between {min(alike):.2f} and {max(alike):.2f} (0 expected)"
    )


def remaining(diagnosis: Diagnosis) -> str:
    """Write what is left with all findings, where and when."""
    unexplained = diagnosis.unexplained
    words = "No data were left unseen."
    if diagnosis.heldout.channels:
        words = (
            "With all findings the error on unseen data is "
            f"{number(unexplained.normalised_rms)} times the noise."
        )
    if unexplained.when:
        words += (
            f" An error at {describe(unexplained.where)} would account for most of what is left; "
            f"{dependence(unexplained.when)}."
        )
    worst = unexplained.worst
    if worst is not None:
        words += (
            f" Compared with what was assumed, the error is greatest in {worst.channel} of "
            f"{worst.recording}, {_span(worst)}, where it is {amount(worst.rms, worst.unit)} rms."
        )
    return words


def _span(stretch: Stretch) -> str:
    if stretch.end - stretch.start < 0.1:
        return f"at {stretch.start:.1f} s"
    return f"from {stretch.start:.1f} to {stretch.end:.1f} s"


def finding_line(index: int, finding: Finding, diagnosis: Diagnosis) -> str:
    """Write a finding in one line: size, what it removes and rivals; its statement if it has no size."""
    if not finding.parameters and finding.effect != "unknown":
        return f"{index}. {place(finding)}: {finding.statement}"
    sizes = ", ".join(f"{plain(name)} {quantity(one)}" for name, one in finding.parameters.items())
    removes = f"; removes {removed(finding, diagnosis)}" if sizes else ""
    if finding.effect in LEFT_OUT:
        removes = f"; {LEFT_OUT[finding.effect]}"
    return f"{index}. {place(finding)}{': ' if sizes else ''}{sizes}{removes}{rivals(finding)}"


def is_valve(finding: Finding) -> bool:
    """Return whether a finding is judged by set-point and pressure alone."""
    channels = finding.evidence.channels
    return bool(channels) and all(name.startswith("pressure_") for name in channels)


def acts_elsewhere(finding: Finding) -> bool:
    """Return whether the unseen data hardly show a finding: a chamber may be vented all the time there."""
    own = finding.evidence
    if own.heldout_before == own.heldout_after:
        return True
    errors = [(own.heldout_before, own.heldout_after), *((e.before, e.after) for e in own.channels.values())]
    return all(abs(before - after) <= HARDLY * max(before, after) for before, after in errors)


def removed(finding: Finding, diagnosis: Diagnosis) -> str:
    """Write the share of the mismatch that a finding removes, and of which mismatch."""
    which = " between set-point and pressure" if is_valve(finding) else ""
    percent = 100.0 * share(finding, diagnosis)
    if acts_elsewhere(finding):
        return "nothing there, since it hardly acts in the unseen data"
    if percent <= 0.0:
        return f"nothing of the mismatch{which}"
    return f"{'less than 1' if percent < 1.0 else f'{percent:.0f}'} % of the mismatch{which}"


def rivals(finding: Finding) -> str:
    """Write what the data cannot distinguish from a finding, with its own probability."""
    if not finding.confusable_with:
        return ""
    others = " or ".join(map(place, finding.confusable_with))
    if finding.effect == "unknown":
        return f"; perhaps {others}"
    if finding.probability is None:
        return f"; these data cannot distinguish it from {others}"
    return (
        f"; these data cannot distinguish it (probability {100.0 * finding.probability:.0f} %) from {others}"
    )


def summary(diagnosis: Diagnosis) -> list[str]:
    """Write a diagnosis in a few lines: verdict, findings, error before and after."""
    lines = [f"{diagnosis.specimen}: {headline(diagnosis)}. {verdict(diagnosis)}"]
    lines += [finding_line(k, one, diagnosis) for k, one in enumerate(diagnosis.findings, start=1)]
    if diagnosis.heldout.channels:
        lines.append(f"Error on unseen data, before and after: {physical(diagnosis.heldout.channels)}.")
        lines += nearer(diagnosis.heldout.channels)
    lines.append(remaining(diagnosis))
    return lines


def nearer(channels: ChannelErrors) -> list[str]:
    """Compare the model with a linear regression on the pressures; empty where there is none."""
    ratios = {name: one.line / one.after for name, one in channels.items() if one.line and one.after}
    if not ratios:
        return []
    worst = min(ratios, key=lambda name: ratios[name])
    return [
        f"The error of a linear regression on the pressures is {number(min(ratios.values()))} ({worst}) to "
        f"{number(max(ratios.values()))} times as large on the same data."
    ]


def _rms(values: Iterable[float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(values)))))

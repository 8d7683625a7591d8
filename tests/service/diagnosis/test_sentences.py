"""Sentences are true of their numbers, and page, terminal and ``report.json`` hold the same numbers."""

import json
import re
from dataclasses import replace

import pytest

from softarm.analysis.diagnosis import sentences
from softarm.analysis.diagnosis.report import report_of
from softarm.estimator.diagnosis import words as effect_words
from softarm.estimator.diagnosis.result import ChannelError, InnovationTest, Quantity
from tests.service.diagnosis.made_diagnosis import (
    consistent,
    diagnosis,
    explained,
    page_of,
    unexplained,
    without_chambers,
)

EVERY = [consistent, diagnosis, explained, unexplained, without_chambers]


@pytest.mark.parametrize(("after", "down"), [(0.9, True), (1.1, True), (1.8, False), (29.8, False)])
def test_down_to_the_noise_is_said_only_where_the_error_is_near_it(after: float, down: bool):
    words = sentences.verdict(explained(after))
    assert ("but not down to the noise" not in words) is down
    assert f"from 40 to {after:g} times the noise" in words


@pytest.mark.parametrize(
    ("before", "words"),
    [
        (8.1, "show in the readings themselves.*stays at 8.1 times"),
        (6.5, "rises from 6.5 to 8.1 times the noise.*doubtful"),
    ],
)
def test_an_error_that_does_not_fall_is_stated(before: float, words: str):
    made = explained(8.1)
    said = sentences.verdict(replace(made, heldout=replace(made.heldout, before=before)))
    assert re.search(words, said)
    assert "explain" not in said


def test_a_verdict_that_unseen_data_contradict_says_so_first():
    made = explained(8.1)
    worse = replace(made, heldout=replace(made.heldout, before=6.5))
    assert sentences.summary(worse)[0].startswith("sopra: explained, but not confirmed. ")
    assert sentences.summary(made)[0].startswith("sopra: explained. ")


def test_a_finding_without_a_name_does_not_show_in_the_readings_themselves():
    missing, known = unexplained().findings[0], explained().findings[0]
    made = replace(unexplained(), verdict="partly_explained", findings=(missing, known))
    words = sentences.verdict(made)
    assert words.startswith("The model is missing physics that no known effect explains. The other findings")


def test_a_consistent_arm_may_have_a_sensor_that_stands_still():
    found = replace(explained().findings[0], effect="sensor_stuck", confusable_with=())
    made = replace(consistent(), findings=(found,))
    words = sentences.verdict(made)
    assert words.startswith(
        "The findings below show in the readings themselves. Apart from them, no missing physics"
    )
    line = sentences.finding_line(1, found, made)
    assert "what the sensor reads meanwhile is not used" in line
    assert "removes" not in line
    assert "removes" not in sentences.effect_on_error(found, made)


def test_no_unseen_data_are_stated_as_such():
    made = replace(consistent(), heldout=replace(consistent().heldout, before=0.0, after=0.0, channels={}))
    assert "0 times the noise" not in " ".join(sentences.summary(made))
    assert "leave no unseen data" in sentences.verdict(made)


def test_recordings_that_could_show_nothing_are_named():
    made = consistent()
    assert "would have shown" not in sentences.verdict(made)
    blind = sentences.verdict(replace(made, detection_limits=()))
    assert (
        "no change of the arm's stiffness or of a chamber's gain, and no payload, would have shown" in blind
    )


def test_the_worst_stretch_is_one_of_what_was_assumed():
    words = sentences.remaining(diagnosis())
    assert "largest" not in words
    assert "Compared with what was assumed, the error is greatest in bend_tip.x of run_04" in words


def test_a_finding_that_removes_nothing_says_so():
    one = explained()
    finding = one.findings[0]
    own = replace(finding.evidence, heldout_before=1.0, heldout_after=2.0)
    line = sentences.finding_line(1, replace(finding, evidence=own), one)
    assert "removes nothing of the mismatch" in line
    elsewhere = replace(finding.evidence, heldout_before=2.0, heldout_after=2.0)
    line = sentences.finding_line(1, replace(finding, evidence=elsewhere), one)
    assert "removes nothing there, since it hardly acts in the unseen data" in line


def test_the_probability_of_a_valve_is_that_of_its_error_and_law():
    finding = explained().findings[0]
    valve = replace(finding.evidence, channels={"pressure_0": ChannelError("Pa", 900.0, 300.0)})
    named = replace(finding, evidence=valve, probability=0.5)
    assert "distinguish it (probability 50 %) from hysteresis" in sentences.rivals(named)
    words = sentences.evidence_sentence(named)
    assert "that the valve errs in this direction and by this law is 50 %" in words


def test_a_verdict_with_nominal_recordings_compares_with_them():
    assert "is 0.31 times the same part in the recordings in the known state." in (
        sentences.verdict(without_chambers())
    )


def test_consistent_says_how_far_the_model_is_off():
    words = sentences.verdict(consistent())
    assert "4 times the noise" in words
    assert "agrees" not in words
    heldout = replace(consistent().heldout, before=1.05, after=1.0)
    assert "agrees with the recordings" in sentences.verdict(replace(consistent(), heldout=heldout))


def test_a_finding_without_a_size_says_what_was_found():
    statement = "b_run: the markers are in millimetres; converted for this run."
    found = replace(unexplained().findings[0], effect="frame_mismatch", statement=statement)
    assert statement in sentences.finding_line(1, found, replace(unexplained(), findings=(found,)))


def test_a_finding_that_has_rivals_names_them():
    one = explained()
    finding = replace(one.findings[0], probability=0.27)
    words = "these data cannot distinguish it (probability 27 %) from hysteresis, the lower segment"
    assert words in sentences.finding_line(1, finding, one)
    assert "distinguish" not in sentences.finding_line(1, replace(finding, confusable_with=()), one)


def test_what_one_pose_shows_is_missing_and_has_perhaps_a_name():
    one = unexplained()
    assert "physics that no known effect explains" in sentences.verdict(one)
    finding = replace(one.findings[0], confusable_with=explained().findings[0].confusable_with)
    shown = replace(one, findings=(finding,))
    assert "show in too few poses to name it" in sentences.verdict(shown)
    assert sentences.finding_line(1, finding, shown).endswith("; perhaps hysteresis, the lower segment")


def test_where_several_names_are_possible_the_verdict_leaves_them_open():
    one = unexplained()
    finding = replace(one.findings[0], confusable_with=2 * explained().findings[0].confusable_with)
    assert "leave several names open" in sentences.verdict(replace(one, findings=(finding,)))


def test_a_valve_removes_its_own_mismatch():
    one = explained()
    finding = one.findings[0]
    valve = replace(finding.evidence, channels={"pressure_0": ChannelError("Pa", 900.0, 300.0)})
    assert "of the mismatch between set-point and pressure" in (
        sentences.finding_line(1, replace(finding, evidence=valve), one)
    )
    assert "set-point" not in sentences.finding_line(1, finding, one)


@pytest.mark.parametrize("made", EVERY)
def test_page_terminal_and_json_agree(made):
    one = made()
    report = json.loads(report_of(one).dump())
    terminal = " ".join(sentences.summary(one))
    text = page_of(made)
    for key in ("normalised_rms_before", "normalised_rms_after"):
        shown = sentences.number(report["heldout"][key])
        assert shown in text
        assert shown in terminal
    for channel, unit in report["heldout"]["unit"].items():
        assert unit in ("deg", "mm")
        for key in ("rms_before", "rms_after"):
            shown = sentences.number(report["heldout"][key][channel])
            assert f"{shown} degrees" in text
            assert shown in terminal
    assert report["unexplained"]["normalised_rms"] == report["heldout"]["normalised_rms_after"]
    for finding in report["findings"]:
        assert effect_words.plain(finding["effect"]) in text
        assert effect_words.plain(finding["effect"]) in terminal


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ((0.55, 0.71), "falls by 66 % (95 % interval over stretches of time: 55 to 71 %)"),
        ((0.871, 0.874), "falls by 65.6 % (95 % interval over stretches of time: 87.1 to 87.4 %)"),
        ((0.87, 0.87), "falls by 66 % (too few stretches of unseen data for an interval)"),
        ((0.87, 0.87000001), "falls by 65.62 % (95 % interval over stretches of time: 87.00 to 87.00 %)"),
    ],
)
def test_a_gain_is_one_interval_whose_bounds_differ(interval, words):
    assert words in sentences.gain(3.2, 1.1, interval)


def test_no_gain_is_not_called_one():
    assert sentences.gain(3.0, 3.1, (-0.1, 0.05)) == "The error on unseen data does not fall."


def test_what_a_finding_removes_follows_from_the_report():
    one = diagnosis()
    (finding,) = one.findings
    assert sentences.share(finding, one) == pytest.approx((3.2 - 1.1) / 3.2)
    assert "removes 66 % of the mismatch" in sentences.effect_on_error(finding, one)
    assert "In bend_tip.x, which it changes most, it would be 1.26 instead of 0.458 degrees." in (
        sentences.effect_on_error(finding, one)
    )


@pytest.mark.parametrize(
    ("log_bayes_factor", "name"),
    [(-2.6, "none"), (0.5, "weak"), (1.2, "substantial"), (3.0, "strong"), (5.0, "decisive")],
)
def test_bayes_factors_have_the_names_of_kass_and_raftery(log_bayes_factor, name):
    assert sentences.strength(log_bayes_factor) == name


def test_the_probability_of_what_has_no_name_is_not_one_of_a_place():
    (named,) = diagnosis().findings
    unnamed_physics = replace(named, effect="unknown", probability=0.97)
    assert sentences.evidence_sentence(unnamed_physics).endswith("no known effect explains it is 97 %.")
    assert sentences.evidence_sentence(replace(named, probability=0.97)).endswith("it acts there is 97 %.")


def innovations(variance, correlation):
    """A test whose residuals are as its innovations."""
    return InnovationTest(variance, correlation, dict.fromkeys(variance, 0.5), variance, correlation)


def test_innovations_are_called_white_only_where_they_are():
    white = innovations({"a": 0.9, "b": 1.2}, {"a": 0.1, "b": -0.05})
    assert sentences.noise(white).startswith("The residual is white noise of the estimated size")
    for other in (
        innovations({"a": 6.0}, {"a": 0.1}),
        innovations({"a": 1.0}, {"a": 0.9}),
        innovations({"a": 0.1}, {"a": 0.0}),
    ):
        assert "not white noise" in sentences.noise(other)


@pytest.mark.parametrize(
    ("value", "words"), [(1530.4, "1,530"), (0.00123, "0.00123"), (29.83, "29.8"), (87.0, "87")]
)
def test_numbers_have_no_exponents(value, words):
    assert sentences.number(value) == words


@pytest.mark.parametrize(("std", "words"), [(0.0021, "52.3 ± 2.1 g"), (0.0, "52.3 g")])
def test_a_parameter_is_written_with_its_deviation_where_it_has_one(std: float, words: str):
    assert sentences.quantity(Quantity(0.0523, std, "kg")) == words

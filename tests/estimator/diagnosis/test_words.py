"""Advice and statements that fit the arm and the numbers."""

import re

import pytest

from softarm.estimator.diagnosis.words import EXCITATION, PNEUMATIC, manoeuvre, possible, sentence_on
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.amounts import Amount
from softarm.estimator.specimen.physics import Place


def test_an_arm_without_chambers_is_never_asked_for_pressures():
    for one in EFFECTS:
        for other in EFFECTS:
            if one != other:
                words = manoeuvre(one, other, pneumatic=False)
                assert words
                assert not any(word in words for word in PNEUMATIC)
    assert not any(word in " ".join(possible(EXCITATION, pneumatic=False)) for word in PNEUMATIC)
    assert len(possible(EXCITATION, pneumatic=True)) == len(EXCITATION)


def test_what_a_mismatch_depends_on_is_a_sentence():
    assert sentence_on("constant") == "The mismatch is constant."
    assert sentence_on("pressure level") == "The mismatch varies with the pressure level."
    assert sentence_on("time since a change") == "The mismatch varies with time since a change."


@pytest.mark.parametrize(
    ("value", "unit", "form", "words"),
    [
        (0.0523, "kg", "", "52.3 g"),
        (0.1, "rad", "", "5.73 degrees"),
        (0.03, "m", "", "30 mm"),
        (1500.0, "Pa", "", "1.5 kPa"),
        (2.0, "s", "", "2 s"),
        (-0.05, "N", "number", "-0.05"),
        (0.15, "1", "percent", "15 %"),
        (-0.2, "1", "less|more", "20 % less"),
        (0.2, "1", "less|more", "20 % more"),
        (0.0, "1", "=at once|in the end", "at once"),
        (1.0, "1", "=at once|in the end", "in the end"),
    ],
)
def test_amounts_are_in_the_units_that_people_read(value: float, unit: str, form: str, words: str):
    assert format(Amount(value, unit), form) == words


def test_a_statement_follows_the_sign_of_its_parameter():
    gain = EFFECTS["chamber_gain"]
    assert gain.sentence(0.0 * gain.typical - 0.22, Place(chamber=2)) == (
        "Pressure in chamber 2 has 22 % less effect than in the model."
    )
    assert "22 % more effect" in gain.sentence(0.0 * gain.typical + 0.22, Place(chamber=2))


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_statements_are_sentences_without_si_angles_or_shares(name: str):
    effect = EFFECTS[name]
    told = effect.sentence(effect.typical, Place(segment="lower"))
    assert told[0].isupper()
    assert not re.search(r"\brad\b|\bPa\b.*\bPa\b.*\bPa\b|\bkg\b|the share", told)

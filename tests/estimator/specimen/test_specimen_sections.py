"""Which sections lie on either side of a height."""

from softarm.estimator.specimen import load_specimen


def test_a_segment_lies_between_the_nearest_sections() -> None:
    sopra = load_specimen("sopra")
    upper, lower = sopra.segments
    assert sopra.section_above(upper.from_m) == "base"
    assert sopra.section_below(upper.to_m) == sopra.section_above(lower.from_m) == "intermediate"
    assert sopra.section_below(lower.to_m) == "tip"


def test_a_section_that_is_left_out_is_passed_over() -> None:
    sopra = load_specimen("sopra")
    upper = sopra.segments[0]
    assert sopra.section_below(upper.to_m, ("base", "tip")) == "tip"
    assert sopra.section_above(upper.from_m, ("intermediate", "tip")) is None

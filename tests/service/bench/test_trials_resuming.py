"""A run of trials that was killed goes on from its whole outcomes."""

from dataclasses import replace

from softarm.bench.trials.outcome import TrialOutcome, add_outcome, read_outcomes

ONE = TrialOutcome("one", 12.5, 640.0, 0, "", {"verdict": "explained"})


def test_outcomes_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "proof" / "results.jsonl"
    assert read_outcomes(path) == []
    other = replace(ONE, trial="two", status=-1, message="ended after 900 s", report={})
    add_outcome(ONE, path)
    add_outcome(other, path)
    assert read_outcomes(path) == [ONE, other]


def test_a_line_that_was_cut_off_is_done_again(tmp_path):
    path = tmp_path / "results.jsonl"
    add_outcome(ONE, path)
    path.write_text(path.read_text() + ONE.line()[:40])
    assert read_outcomes(path) == [ONE]
    add_outcome(replace(ONE, seconds=3.0), path)
    assert read_outcomes(path) == [ONE, replace(ONE, seconds=3.0)]

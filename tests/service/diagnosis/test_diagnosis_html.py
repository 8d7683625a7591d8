"""The page tells every part of a diagnosis and fetches nothing."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from softarm.analysis.diagnosis.charts import Curve, against, over_time
from softarm.analysis.diagnosis.drawing import colour
from softarm.analysis.diagnosis.html import _chance, page, write_html
from softarm.estimator.diagnosis.result import LocationMap
from softarm.estimator.specimen import load_specimen
from tests.service.diagnosis.made_diagnosis import diagnosis, finding, trace

VOID = {"meta", "br"}


class Balance(HTMLParser):
    """Collects the open elements and the text of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        """Closed at once."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def read(text: str) -> Balance:
    parser = Balance()
    parser.feed(text)
    parser.close()
    return parser


def test_the_page_is_well_formed_and_fetches_nothing():
    text = page(diagnosis(), load_specimen("sopra"))
    assert read(text).open == []
    assert not re.search(r"https?:|//|src=|href=|@import|url\(|<script|<link", text)


def test_the_page_tells_each_finding_its_numbers_rivals_and_losers():
    told = read(page(diagnosis(), load_specimen("sopra"))).text
    for words in (
        finding().statement,
        "viscoelastic creep",
        "0.152",
        "8.1 ± 0.4 s",
        "ramps at two rates",
        "thermal drift",
        "Every third run is held out.",
        "mullins softening: cycles of growing amplitude",
        "12 gaps of up to 0.14 s.",
        "segment upper",
        "3.20",
        "1.10",
    ):
        assert words in told


def test_a_consistent_diagnosis_names_nothing():
    empty = replace(diagnosis(), verdict="consistent", findings=(), map=LocationMap(), traces=())
    told = read(page(empty, load_specimen("sopra"))).text
    assert "No effect is named." in told
    assert "agrees with the recordings" in told


def test_every_shipped_specimen_is_drawn():
    for name in ("sopra", "single_segment", "beam"):
        specimen = load_specimen(name)
        told = read(page(diagnosis(), specimen)).text
        assert all(part.name in told for part in (*specimen.segments, *specimen.sections))


def test_colours_go_from_grey_to_red():
    red = [int(colour(share)[4:-1].split(",")[1]) for share in (0.0, 0.3, 0.7, 1.0, 5.0)]
    assert red[0] > red[1] > red[2] > red[3] == red[4]


def test_curves_break_where_readings_are_lost():
    one = trace()
    chart = over_time(one.time, [Curve("measured", "#000", one.measured)], "rad", one.heldout)
    path = re.search(r'<path d="(M[^"]*)" fill="none" stroke="#000"', chart)
    assert path is not None
    assert path.group(1).count("M") == 2
    assert "nan" not in chart


def test_charts_of_nothing_at_all_are_drawn():
    lost = np.full(50, np.nan)
    assert read(over_time(np.arange(50.0), [Curve("lost", "#000", lost)], "rad")).open == []
    assert read(against(lost, [Curve("lost", "#000", lost)], "x", "m")).open == []
    assert read(against(np.zeros(50), [Curve("still", "#000", np.zeros(50))], "x", "m")).open == []


def test_the_file_is_written_whole(tmp_path: Path):
    path = write_html(diagnosis(), load_specimen("beam"), tmp_path / "new")
    assert path.read_text().startswith("<!doctype html>")
    assert write_html(diagnosis(), load_specimen("beam"), tmp_path / "new") == path


def test_a_variable_that_never_changes_is_drawn_in_the_middle() -> None:
    chart = against(np.full(5, 8.3), [Curve("without it", "#000", np.arange(5.0))], "pose [degrees]", "m")
    assert "M405.0 " in chart


def test_a_chance_that_was_never_drawn_is_not_called_nought() -> None:
    assert _chance(0.0) == "below 0.0025"
    assert _chance(0.0123) == "0.012"

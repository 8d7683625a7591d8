"""The page shows every part of a diagnosis, fetches nothing, and escapes what recordings are named."""

import re
import xml.etree.ElementTree as ET
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from softarm.analysis.diagnosis.figures import (
    binned,
    colour,
    draw_arm,
    draw_exposure,
    draw_trace,
    worst_window,
)
from softarm.analysis.diagnosis.html import page, write_html
from softarm.estimator.diagnosis.result import Diagnosis, LocationMap
from softarm.estimator.specimen import load_specimen
from tests.service.diagnosis.made_diagnosis import (
    consistent,
    diagnosis,
    explained,
    finding,
    page_of,
    trace,
    unexplained,
    without_chambers,
)

VOID = {"meta", "br", "img"}
HOSTILE = '<script>alert(1)</script> & "x" $\\frac{1}{0}$ ]]>'


class Page(HTMLParser):
    """Collects the open elements, the text, the images and the names of all elements of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.images: list[str] = []
        self.elements: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.elements.add(tag)
        if tag == "img":
            self.images.append(dict(attrs)["src"])
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def read(text: str) -> Page:
    parser = Page()
    parser.feed(text)
    parser.close()
    return parser


def svg(address: str) -> str:
    kind, _, content = address.partition(",")
    assert kind == "data:image/svg+xml;base64"
    return b64decode(content).decode()


def words_of(address: str) -> str:
    return " ".join(element.text or "" for element in ET.fromstring(svg(address)).iter())


@pytest.mark.parametrize("made", [diagnosis, consistent, explained, unexplained])
def test_the_page_is_well_formed_and_fetches_nothing(made):
    text = page_of(made)
    found = read(text)
    assert found.open == []
    assert not found.elements & {"script", "link", "iframe", "object"}
    without_images = re.sub(r'src="data:image/svg\+xml;base64,[A-Za-z0-9+/=]*"', "", text)
    assert not re.search(r"https?:|//|src=|href=|@import|url\(", without_images)
    for image in found.images:
        assert not re.search(r'href="(?!#)|<script|url\((?!#)', svg(image))


def test_the_page_shows_each_finding_its_numbers_rivals_and_losers():
    told = " ".join(read(page_of(diagnosis)).text.split())
    for words in (
        finding().statement,
        "viscoelastic creep",
        "0.152",
        "8.1 ± 0.4 s",
        "ramps at two rates",
        "thermal drift",
        "decisive (ln B = 206)",
        "Unseen data: every third run.",
        "mullins softening: cycles of growing amplitude",
        "12 gaps of up to 0.14 s.",
        "the upper segment",
        "1.26 degrees → 0.458 degrees",
        "3.2 → 1.1",
        "bend_tip.x of run_04, from 12.0 to 15.0 s, where it is 1.15 degrees rms",
    ):
        assert words in told


def test_names_from_recordings_and_specimens_are_escaped():
    """A recording, a channel and a note may hold any character, and none of them acts on the page."""
    one = replace(trace(), recording=HOSTILE, channel=HOSTILE)
    found = replace(finding(), statement=HOSTILE, exposure=replace(finding().exposure, variable=HOSTILE))
    hostile = replace(
        diagnosis(),
        specimen=HOSTILE,
        recordings=(HOSTILE,),
        notes=(HOSTILE,),
        traces=(one,),
        findings=(found,),
    )
    text = page(hostile, load_specimen("sopra"))
    parsed = read(text)
    assert "script" not in parsed.elements
    assert parsed.text.count(HOSTILE) >= 5
    pictures = [svg(image) for image in parsed.images]
    assert not any("<script" in picture for picture in pictures)
    assert any(HOSTILE in words_of(image) for image in parsed.images)


def test_a_consistent_diagnosis_names_nothing():
    empty = replace(consistent(), map=LocationMap(), traces=())
    told = read(page(empty, load_specimen("sopra"))).text
    assert "No effect is named." in told
    assert "No missing physics was found." in told


def test_an_arm_without_chambers_gets_no_advice_on_pressures():
    told = read(page_of(without_chambers)).text
    assert "external force, the tip section. To decide, record: the mount turned." in told
    assert "softarm excite" not in told
    assert "chamber driven" not in told


def test_every_shipped_specimen_is_drawn():
    for name in ("sopra", "single_segment", "beam"):
        specimen = load_specimen(name)
        told = words_of(draw_arm(specimen, diagnosis().map.by_place()))
        assert all(part.name in told for part in (*specimen.segments, *specimen.sections))


def test_colours_go_from_grey_to_red():
    green = [colour(share)[1] for share in (0.0, 0.3, 0.7, 1.0, 5.0)]
    assert green[0] > green[1] > green[2] > green[3] == green[4]


def test_the_zoom_is_where_the_mismatch_is_largest():
    one = trace()
    bump = one.before + np.where((one.time > 30.0) & (one.time < 32.0), 0.3, 0.0)
    chosen = one.time[worst_window(replace(one, measured=bump))]
    assert chosen[0] <= 30.0 + 0.1
    assert chosen[-1] >= 32.0 - 0.1
    assert np.ptp(chosen) < 6.0


def test_figures_of_nothing_at_all_are_drawn():
    lost = np.full(50, np.nan)
    assert "time [s]" in words_of(
        draw_trace(
            replace(
                trace(),
                time=np.arange(50.0),
                measured=lost,
                before=lost,
                after=lost,
                heldout=np.zeros(50, dtype=bool),
            )
        )
    )
    assert draw_exposure(replace(finding().exposure, values=np.zeros(900)))
    assert len(binned(np.zeros(50), lost)[0]) == 0


def test_means_in_bins_follow_the_residual():
    values = np.linspace(0.0, 1.0, 400)
    middles, means = binned(values, 2.0 * values)
    assert len(middles) > 10
    assert np.allclose(means, 2.0 * middles, atol=0.01)


def test_the_file_is_written_whole_and_alike_each_time(tmp_path: Path):
    def written(one: Diagnosis) -> bytes:
        return write_html(one, load_specimen("beam"), tmp_path / "new").read_bytes()

    first = written(diagnosis())
    assert first.startswith(b"<!doctype html>")
    assert written(diagnosis()) == first


def test_the_page_states_how_large_an_effect_would_have_to_be():
    text = read(page_of(consistent)).text
    assert "tip payload" in text
    assert "12 g" in text

"""The pages of a recording and of a diagnosis in a real browser."""

import contextlib
from dataclasses import replace

import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.analysis.diagnosis.motion import load_motions
from softarm.analysis.diagnosis.report import read_report
from softarm.estimator.specimen.physics import Place
from softarm.page.diagnosis import DiagnosisPage
from softarm.page.recording import RecordingPage
from softarm.page.server import page_server
from softarm.recordings.events import RecordedEvent
from tests.service.diagnosis.made_diagnosis import finding
from tests.service.page.browser import BROWSER, DRIVER, open_browser, without_reflections
from tests.service.page.test_diagnosis_page import ARM, BELOW, SURFACE, written
from tests.service.page.test_playback import ARM as STRAIGHT
from tests.service.page.test_playback import recording
from tests.service.page.test_server import free_port

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (BROWSER and DRIVER), reason="no chromium: apt-get install chromium chromium-driver"
    ),
]
EVENTS = (
    RecordedEvent(0.2, "mode", "left", "IDLE -> ARMED: arm"),
    RecordedEvent(0.4, "finding", "bend_tip", "no valid reading for 0.16 s"),
)
END, HOME, TAB, SELECT_ALL = "\ue010", "\ue011", "\ue004", "\ue009a\ue000"  # as WebDriver writes the keys


@contextlib.contextmanager
def opened(server, folder):
    """Open a browser on a server; it ends first, since a server that stops waits for who is connected."""
    without_reflections(server)
    with open_browser(f"http://127.0.0.1:{server.get_port()}", folder) as browser:
        browser.open()
        yield browser


def test_the_slider_and_play_move_everything_that_is_in_view(tmp_path):
    with (
        page_server("127.0.0.1", free_port(), "past") as server,
        RecordingPage(recording(), STRAIGHT, SURFACE, server, EVENTS) as page,
        opened(server, tmp_path) as browser,
    ):
        browser.until_shown("Started by: ann")
        for name in ("#about", "#events", "#forces", ".uplot-container", "#pressures"):
            assert browser.covering(name) == [], name
        assert browser.covering(browser.button("Play / pause")) == []
        assert browser.run("return document.querySelector('#stop').hidden")  # nothing moves here
        assert "Nothing yet." in browser.text("#events")
        assert browser.run("return document.querySelectorAll('.mantine-Slider-mark').length") == len(EVENTS)

        browser.slide(END)
        browser.until_shown("1.000 ± 0.020")
        browser.until_shown("tip 0.200 N")
        browser.until_shown("0.40 s, finding: bend_tip: no valid reading for 0.16 s")
        assert "0.20 s, mode: IDLE -> ARMED: arm" in browser.text("#events")
        surface, _ = page._scene._shown
        assert surface[4:].mean(axis=0)[0] > 0.1  # the tip is bent along x

        browser.slide(HOME)
        browser.until_shown("0.000 ± 0.020")
        browser.field("Time [s]").send_keys(SELECT_ALL, "1.7", TAB)
        browser.until_shown("0.800 ± 0.020")
        browser.click("Play / pause")
        browser.until_shown("1.000 ± 0.020")  # it has played to its end
        browser.click("Play / pause")
        browser.until(lambda: "1.000 ±" not in browser.text("#forces"))  # it begins anew


def test_findings_are_marked_on_the_arm_beside_what_they_explain(tmp_path):
    sensor = replace(finding(), effect="sensor_bias", where=Place(section="base"), probability=0.42)
    written(tmp_path, findings=(replace(finding(), probability=0.98), sensor))
    report = read_report(tmp_path)
    with (
        page_server("127.0.0.1", free_port(), "past") as server,
        DiagnosisPage(
            report,
            load_motions(tmp_path, report.recordings),
            ARM,
            SURFACE,
            server,
        ) as page,
        opened(server, tmp_path) as browser,
    ):
        browser.until_shown("viscoelastic creep, the lower segment")
        for name in ("#about", "#finding", "#scale", ".uplot-container", "#channels", "#pressures"):
            assert browser.covering(name) == [], name
        words = browser.text("#finding")
        for told in ("creeps <by 15 %> & comes back", "0.152 ± 0.01", "8.1 ± 0.4 s", "98 %", "hysteresis"):
            assert told in words
        assert (
            "Partly explained. Error on unseen data: 3.2 times the noise before, 1.1 after."
            in browser.text("#about")
        )
        assert (page._scene._shown[1] == BELOW).all()

        browser.slide(END)
        browser.until_shown("Measured minus predicted at 2.00 s")
        assert "1.15 degrees" in browser.text("#channels")
        page._chosen.value = "2. sensor bias, the base section"
        browser.until_shown("42 %")
        browser.until(lambda: (page._scene._shown[1] == ~BELOW).all())

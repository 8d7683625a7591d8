"""The page of a recording in a real browser, and how the command refuses what it cannot show."""

import signal
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.cli.page import command
from softarm.estimator.errors import InputError
from softarm.page.recording import RecordingPage
from softarm.page.server import page_server
from softarm.recordings.events import RecordedEvent
from softarm_client.messages import Surface
from tests.service.page.browser import BROWSER, DRIVER, open_browser, without_reflections
from tests.service.page.test_playback import BODY, LENGTH_M, recording
from tests.service.page.test_server import free_port

EXAMPLE = Path(__file__).parents[3] / "examples" / "recordings" / "sopra_pull"
RING = [(0.03, 0.0), (0.0, 0.03), (-0.03, 0.0), (0.0, -0.03)]
SURFACE = Surface(
    triangles=((0, 1, 4), (1, 5, 4)), rest_m=tuple((x, y, z) for z in (0.0, LENGTH_M) for x, y in RING)
)
EVENTS = (
    RecordedEvent(0.2, "mode", "left", "IDLE -> ARMED: arm"),
    RecordedEvent(0.4, "finding", "bend_tip", "no valid reading for 0.16 s"),
)
BLOCKS = ("#about", "#events", "#forces", ".uplot-container", "#pressures")
END, HOME = "\ue010", "\ue011"  # as WebDriver writes the keys


def test_a_recording_without_estimates_is_refused_before_a_page_is_open():
    with pytest.raises(InputError, match="run softarm estimate RECORDING"):
        CliRunner().invoke(
            command,
            ["--recording", str(EXAMPLE), "--port", str(free_port())],
            standalone_mode=False,
            catch_exceptions=False,
        )
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize(
    ("options", "refusal"),
    [
        (["--recording", str(EXAMPLE), "--arm", "sopra"], "either --recording, or --diagnosis, or --arm"),
        (["--recording", str(EXAMPLE), "--diagnosis", "out"], "either --recording, or --diagnosis"),
        (["--diagnosis", "out", "--specimen", "sopra"], "--specimen is for --recording"),
    ],
)
def test_what_does_not_fit_on_one_page_is_refused(options, refusal):
    refused = CliRunner().invoke(command, options)
    assert refused.exit_code == 2
    assert refusal in refused.output


@pytest.mark.browser
@pytest.mark.skipif(not (BROWSER and DRIVER), reason="no chromium: apt-get install chromium chromium-driver")
def test_the_slider_and_play_move_everything_that_is_in_view(tmp_path):
    port, whole = free_port(), recording()
    short = replace(whole, time=whole.time / 4)  # half a second to play
    with (
        page_server("127.0.0.1", port, "pull") as server,
        RecordingPage(short, BODY, SURFACE, server, EVENTS) as page,
        open_browser(f"http://127.0.0.1:{port}", tmp_path) as browser,
    ):
        without_reflections(server)
        browser.open()
        browser.until_shown("Started by: ann")
        for name in BLOCKS:
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
        browser.click("Play / pause")
        browser.until_shown("1.000 ± 0.020")  # it has played to its end
        browser.click("Play / pause")
        browser.until(lambda: "1.000 ±" not in browser.text("#forces"))  # it begins anew

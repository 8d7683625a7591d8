"""The operator page in a real browser without a screen: what is clicked is what the service does."""

import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm_client import Arm
from softarm_client.modes import Mode
from tests.service.page.browser import BROWSER, DRIVER, open_browser, without_reflections
from tests.service.page.test_server import free_port

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (BROWSER and DRIVER), reason="no chromium: apt-get install chromium chromium-driver"
    ),
]
ESCAPE = "\ue00c"  # as WebDriver writes the key
BLOCKS = ("#stop", "#status", "#status .mode", "#forces", ".uplot-container", "#pressures", "#instruments")
BLOCKS += ("#model", "#recording", "#stress")
TEACH = "Teach (keep pressed)"
BUTTONS = (TEACH, "Hold pose", "Release", "Disarm", "Clear", "Tare", "Save pose", "Go to")
BUTTONS += ("Start recording", "End recording")


@pytest.fixture(scope="module")
def page(service):
    from softarm.page.app import Page
    from softarm.page.server import page_server
    from softarm.page.waiting import ask_arm

    client = Arm("page", service.endpoint, name="operator page")
    port = free_port()
    with (
        pytest.MonkeyPatch.context() as patch,
        client,
        page_server("127.0.0.1", port, "page") as server,
    ):
        without_reflections(server)
        patch.setattr("softarm.page.app.REFRESH_S", 0.4)  # without a graphics card each picture takes long
        with Page(ask_arm(client), server) as shown:
            shown.address = f"http://127.0.0.1:{port}"
            yield shown


@pytest.fixture(scope="module")
def opened(page, tmp_path_factory):
    with open_browser(page.address, tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture
def browser(service, opened):
    """The page, which all tests share; each leaves the arm vented."""
    service.until(Mode.IDLE)
    opened.open()
    opened.until_shown("IDLE")
    return opened


@pytest.fixture
def hold_pose(service, page, browser, monkeypatch):
    def hold():
        """Teach and hold, until nothing but the held pose keeps the lease."""
        monkeypatch.setattr("softarm.page.operator.GRACE_S", 20.0)  # a click may take long on a busy machine
        browser.press(TEACH)
        service.until(Mode.TEACH)
        browser.let_go()
        browser.click("Hold pose")
        service.until(Mode.HOLDING)
        page._controls.operator._pressed_s = float("-inf")

    return hold


def test_everything_is_in_view_at_1280_by_720(browser):
    browser.until_shown("They agree")
    for name in BLOCKS:
        assert browser.covering(name) == [], name
    for name in BUTTONS:
        assert browser.covering(browser.button(name)) == [], name
    assert browser.title == "page"


def test_teach_hold_release_and_stop_through_the_page(service, page, browser, hold_pose):
    browser.until_shown("0.412 ± 0.032")
    browser.press(TEACH)
    service.until(Mode.TEACH)
    browser.until_shown("The pose can be reached.")
    browser.let_go()
    service.until(Mode.IDLE)  # nobody holds the dead-man: the lease runs out

    hold_pose()
    browser.click("Save pose")
    browser.until_shown("pose-1 is saved")
    browser.until(lambda: page._scene._scene._handle_from_node_name["/base/ghost"].visible)
    with pytest.raises(AssertionError):
        service.until(Mode.IDLE, within=2.0)  # twice the lease: a held pose outlives the dead-man
    browser.click("Release")
    service.until(Mode.IDLE)
    browser.until_shown("IDLE")

    browser.click("Go to")
    service.until(Mode.HOLDING)
    browser.click_stop()
    service.until(Mode.FAULTED)
    browser.until_shown("stopped by operator page")
    browser.click("Clear")
    service.until(Mode.IDLE)


def test_escape_stops_wherever_the_focus_is(service, browser):
    for focus in (lambda: None, browser.field("File").click, browser.field("Saved").click):
        focus()
        browser.press_key(ESCAPE)
        service.until(Mode.FAULTED)
        browser.until_shown("FAULTED")
        browser.click("Clear")
        service.until(Mode.IDLE)


def test_recording_is_started_ended_and_named(service, browser):
    browser.click("Start recording")
    browser.until(lambda: "● recording" in browser.text("#recording"))
    browser.click("End recording")
    browser.until_shown("Nothing is recorded")


def test_silent_service_greys_its_readings_and_stop_still_stops(service, browser):
    assert not browser.greyed("#pressures")
    with service.silent():
        browser.until_shown("NO SERVICE")
        for block in ("#forces", ".uplot-container", "#pressures", "#instruments", "#model", "#recording"):
            browser.until(lambda block=block: browser.greyed(block))
        assert not browser.button("Disarm").is_enabled()
        assert browser.covering("#stop") == []
        browser.click_stop()
        service.until(Mode.FAULTED)
    browser.until(lambda: not browser.greyed("#pressures"))
    browser.click("Clear")
    service.until(Mode.IDLE)


def test_page_that_is_left_behind_vents_the_arm(service, browser, hold_pose):
    hold_pose()
    browser.leave()
    service.until(Mode.IDLE)


def test_browser_that_has_lost_the_page_says_so(page, browser):
    page._panel.show_age = lambda age_s: None  # as if the page's process stood still
    try:
        browser.until_shown("no connection to the page")
    finally:
        del page._panel.show_age
    browser.until_shown("or press Esc")

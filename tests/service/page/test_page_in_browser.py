"""The operator page in a real browser without a screen: what is clicked is what the service does."""

import shutil
import socket

import pytest

from softarm_client import Arm
from softarm_client.modes import Mode

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed: softarm[dev]")
pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (BROWSER and DRIVER), reason="no chromium: apt-get install chromium chromium-driver"
    ),
]
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--window-size=1000,900",
)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Browser:
    """The page as an operator has it before him."""

    def __init__(self, driver):
        from selenium.webdriver.support.ui import WebDriverWait

        self._driver = driver
        self._wait = WebDriverWait(driver, 30.0)

    def button(self, text):
        path = f"//button[.//*[normalize-space(text())='{text}'] or normalize-space(text())='{text}']"
        return self._wait.until(lambda driver: driver.find_element("xpath", path))

    def click(self, text):
        self.button(text).click()  # scrolls, and refuses to click what lies over the button

    def press(self, text):
        webdriver.ActionChains(self._driver).click_and_hold(self.button(text)).perform()

    def let_go(self):
        webdriver.ActionChains(self._driver).release().perform()

    @property
    def title(self):
        return self._driver.title

    def until_shown(self, text):
        self._wait.until(lambda driver: text in driver.find_element("tag name", "body").text)


@pytest.fixture
def page(service, monkeypatch):
    from softarm.page.app import Page
    from softarm.page.server import page_server
    from softarm.page.waiting import ask_arm

    monkeypatch.setattr("softarm.page.operator.GRACE_S", 6.0)  # without a graphics card a click takes long
    client = Arm("page", service.endpoint, name="operator page")
    port = free_port()
    with client, page_server("127.0.0.1", port, "page") as server, Page(ask_arm(client), server):
        yield port


@pytest.fixture
def browser(page, tmp_path):
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f"--user-data-dir={tmp_path / 'profile'}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        driver.get(f"http://127.0.0.1:{page}")
        yield Browser(driver)
    finally:
        driver.quit()


def test_teach_hold_release_and_stop_through_the_page(service, browser):
    browser.until_shown("IDLE")
    assert browser.title == "page"
    browser.until_shown("tip: 0.412 N")

    browser.press("Teach (keep pressed)")
    service.until(Mode.TEACH)
    browser.until_shown("The pose can be reached.")
    browser.let_go()
    service.until(Mode.IDLE)  # nobody holds the dead-man: the lease runs out

    browser.press("Teach (keep pressed)")
    service.until(Mode.TEACH)
    browser.let_go()
    browser.click("Hold pose")
    service.until(Mode.HOLDING)
    browser.click("Save pose")
    browser.until_shown("pose-1 is saved")
    with pytest.raises(AssertionError):
        service.until(Mode.IDLE, within=8.0)  # a held pose outlives the dead-man
    browser.click("Release")
    service.until(Mode.IDLE)

    browser.click("Go to")
    service.until(Mode.HOLDING)
    browser.click("STOP")
    service.until(Mode.FAULTED)
    browser.until_shown("stopped by operator page")
    browser.click("Clear")
    service.until(Mode.IDLE)


def test_page_that_is_gone_leaves_the_arm_vented(service, page, browser):
    browser.press("Teach (keep pressed)")
    service.until(Mode.TEACH)
    browser.let_go()
    browser.click("Hold pose")
    service.until(Mode.HOLDING)
    browser._driver.quit()
    service.until(Mode.IDLE)

"""A headless Chromium with an operator page of 1280 by 720 pixels before it."""

import contextlib
import shutil

import pytest

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed: softarm[dev]")

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
WIDTH, HEIGHT = 1280, 720
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
)
VIEWPORT = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
COVERING = """
const element = typeof arguments[0] === "string" ? document.querySelector(arguments[0]) : arguments[0];
const box = element.getBoundingClientRect();
const across = (box.left + box.right) / 2, down = (box.top + box.bottom) / 2;
return [[box.left + 10, down], [box.right - 10, down], [across, box.top + 2], [across, box.bottom - 2]]
  .map(([x, y]) => [x, y, document.elementFromPoint(x, y)])
  .filter(([x, y, shown]) => !element.contains(shown))
  .map(([x, y, shown]) => `${x}, ${y}: ${shown?.outerHTML.slice(0, 200)}`);
"""
"""What is shown where an edge of an element should be: nothing outside the window, or what covers it.

Ten pixels from the sides, since a panel's invisible handle reaches six pixels into it.
"""


class Browser:
    """The page as an operator has it before him."""

    def __init__(self, driver, address):
        from selenium.webdriver.support.ui import WebDriverWait

        self._driver = driver
        self._address = address
        self._wait = WebDriverWait(driver, 30.0, poll_frequency=0.1)

    def open(self):
        if not self._driver.current_url.startswith(self._address):
            self._driver.get(self._address)

    def leave(self):
        self._driver.get("about:blank")

    def button(self, text):
        path = f"//button[.//*[normalize-space(text())='{text}'] or normalize-space(text())='{text}']"
        return self._wait.until(lambda driver: driver.find_element("xpath", path))

    def field(self, label):
        path = f"//label[.='{label}']/following::input[not(@type='hidden')][1]"
        return self._wait.until(lambda driver: driver.find_element("xpath", path))

    def slide(self, key):
        """Press a key on the slider: End, Home or an arrow."""
        self._driver.find_element("css selector", "[role=slider]").send_keys(key)

    def run(self, script, *arguments):
        return self._driver.execute_script(script, *arguments)

    def covering(self, element):
        return self.run(COVERING, element)

    def greyed(self, selector):
        return "grayscale" in self.run(
            "return getComputedStyle(document.querySelector(arguments[0])).filter", selector
        )

    def text(self, selector):
        return self.run("return document.querySelector(arguments[0]).innerText", selector)

    def click(self, text):
        self.button(text).click()  # refuses to click what lies over the button

    def click_stop(self):
        self._driver.find_element("css selector", "#stop").click()

    def press(self, text):
        webdriver.ActionChains(self._driver).click_and_hold(self.button(text)).perform()

    def let_go(self):
        webdriver.ActionChains(self._driver).release().perform()

    def press_key(self, key):
        webdriver.ActionChains(self._driver).send_keys(key).perform()

    @property
    def title(self):
        return self._driver.title

    def until(self, accept):
        self._wait.until(lambda _: accept())

    def until_shown(self, text):
        self.until(lambda: text in self.text("body"))

    def click_away_notices(self):
        """Close what viser says of a browser without a graphics card."""
        notice = "button.mantine-Notification-closeButton"
        self._wait.until(lambda driver: driver.find_element("css selector", notice)).click()

    def picture(self, path):
        self._driver.save_screenshot(str(path))


def without_reflections(server):
    """Leave out light from the surroundings, which takes seconds to prepare without a graphics card."""
    server.scene.configure_environment_map(hdri=None)


@contextlib.contextmanager
def open_browser(address, folder):
    """Open a browser; the profile goes into the folder."""
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f"--user-data-dir={folder / 'profile'}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", VIEWPORT)
        yield Browser(driver, address)
    finally:
        driver.quit()

"""Take the pictures of the documents: ``python -m tests.service.page.picture FILE [OPTION PATH TIME]``.

Without an option it is one of the operator page; ``--recording FILE`` and ``--diagnosis FOLDER`` are those of
``softarm page``, at a time [s].
"""

import subprocess
import sys
import tempfile
import threading
from itertools import count
from pathlib import Path

from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.experiments.force import compare_forces
from softarm.experiments.live import live_fakes
from softarm.experiments.rig import FakeRig, RigSettings, free_endpoint
from softarm.experiments.session import connect
from softarm.page.app import Page
from softarm.page.server import page_server
from softarm.page.waiting import ask_arm
from softarm_client import Arm
from tests.service.page.browser import open_browser
from tests.service.page.test_server import free_port

SELECT_ALL, TAB = "\ue009a\ue000", "\ue004"
"""As WebDriver writes the keys."""


def take_picture(path, folder):
    """Pull at a simulated arm under pressure, and take the picture at the last look."""
    settings = RigSettings(
        DEMO_SCENARIO,
        specimen=str(fake_specimen()),
        endpoint=free_endpoint(),
        forces_on=("tip",),
        patience=5.0,
    )
    port, looks, steps = free_port(), count(1), 4
    last = 2 * steps
    with (
        FakeRig(settings, folder) as rig,
        connect(rig) as client,
        Arm(settings.arm, settings.endpoint, name="operator page") as watching,
        page_server("127.0.0.1", port, settings.arm) as server,
        open_browser(f"http://127.0.0.1:{port}", folder) as browser,
        live_fakes(rig, client) as live,
        Page(ask_arm(watching), server),
    ):
        browser.open()
        browser.click_away_notices()
        compare_forces(live, lambda: browser.picture(path) if next(looks) == last else None, steps)


def take_picture_of_past(path, folder, option, shown, time_s):
    """Take the picture of the page of a recording or of a diagnosis at a time [s]."""
    port = free_port()
    command = [sys.executable, "-m", "softarm", "page", option, shown, "--port", str(port)]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        open_browser(f"http://127.0.0.1:{port}", folder) as browser,
    ):
        try:
            process.stdout.readline()
            browser.open()
            browser.button("Play / pause")
            browser.click_away_notices()
            browser.field("Time [s]").send_keys(SELECT_ALL, str(time_s), TAB)
            browser.until(lambda: browser.field("Time [s]").get_attribute("value") == str(time_s))
            threading.Event().wait(3.0)  # without a graphics card each picture takes long
            browser.picture(path)
        finally:
            process.terminate()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        if len(sys.argv) == 2:
            take_picture(Path(sys.argv[1]), Path(folder))
        else:
            take_picture_of_past(Path(sys.argv[1]), Path(folder), *sys.argv[2:])

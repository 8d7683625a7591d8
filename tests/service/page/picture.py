"""Take the picture of the operator page for the documents: ``python -m tests.service.page.picture FILE``."""

import sys
import tempfile
from itertools import count
from pathlib import Path

from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.experiments.force import ForceSettings
from softarm.experiments.rig import FakeRig, RigSettings, free_endpoint
from softarm.experiments.session import connect, force_on_fakes, wait_ready
from softarm.page.app import Page
from softarm.page.server import page_server
from softarm.page.waiting import ask_arm
from softarm_client import Arm
from tests.service.page.browser import open_browser
from tests.service.page.test_server import free_port


def take_picture(path, folder):
    """Pull at a simulated arm under pressure, and take the picture at the last look."""
    settings = RigSettings(
        DEMO_SCENARIO,
        specimen=str(fake_specimen()),
        endpoint=free_endpoint(),
        forces_on=("tip",),
        patience=5.0,
    )
    force, port, looks = ForceSettings(steps=4), free_port(), count(1)
    last = 2 * force.steps
    with (
        FakeRig(settings, folder) as rig,
        connect(rig) as client,
        Arm(settings.arm, settings.endpoint, name="operator page") as watching,
        page_server("127.0.0.1", port, settings.arm) as server,
        open_browser(f"http://127.0.0.1:{port}", folder) as browser,
    ):
        wait_ready(client)
        with Page(ask_arm(watching), server):
            browser.open()
            browser.click_away_notices()
            force_on_fakes(rig, client, force, lambda: browser.picture(path) if next(looks) == last else None)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        take_picture(Path(sys.argv[1]), Path(folder))

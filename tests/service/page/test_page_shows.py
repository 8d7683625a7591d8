"""What the page shows of a service, read from its texts without a browser."""

import threading
import time

import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.page.app import Page
from softarm.page.server import page_server
from softarm.page.waiting import ask_arm
from softarm_client import Arm
from tests.service.page.test_server import free_port


@pytest.fixture
def page(service):
    client = Arm("page", service.endpoint, name="operator page")
    with (
        client,
        page_server("127.0.0.1", free_port(), "page") as server,
        Page(ask_arm(client), server) as running,
    ):
        yield running


def until(accept, within=20.0):
    deadline = time.monotonic() + within
    while not accept():
        assert time.monotonic() < deadline
        threading.Event().wait(0.02)


def test_silent_service_greys_the_page_within_half_a_second(service, page):
    panel, inputs = page._panel, page._controls._inputs
    until(lambda: "IDLE" in panel._status.content and "0.412" in panel._forces.content)
    until(lambda: not any(button.disabled for button in inputs))
    with service.silent():
        gone = time.monotonic()
        until(lambda: "NO SERVICE" in panel._status.content)
        assert time.monotonic() - gone < 1.0  # half a second, and what a busy machine adds
        assert "last mode was IDLE" in panel._status.content
        until(lambda: "#pressures" in panel._beat.content)
        until(lambda: all(button.disabled for button in inputs))
        until(lambda: page._scene._stale)
    until(lambda: "IDLE" in panel._status.content and "grey" not in panel._beat.content)


def test_old_estimates_are_grey_while_the_service_is_heard(page, monkeypatch):
    panel = page._panel
    until(lambda: "0.412" in panel._forces.content)
    monkeypatch.setattr("softarm.page.panel.ESTIMATE_OLD_S", -1.0)
    until(lambda: "#forces" in panel._beat.content and "#pressures" not in panel._beat.content)


def test_curves_carry_the_names_of_the_sections_of_the_estimate(page):
    panel = page._panel
    until(lambda: panel._curve is not None)
    assert [series["label"] for series in panel._curve.series[1:]] == ["intermediate", "tip"]


def test_recording_and_taring_are_commands_of_the_page(service, page):
    controls = page._controls
    controls.operator.record("from-the-page")
    until(lambda: "from-the-page" in controls._recording.content.replace("&#45;", "-"))
    controls.operator.end_recording()
    until(lambda: "Nothing is recorded" in controls._recording.content)
    controls.operator.tare()
    until(lambda: "<b>0.000</b>" in page._panel._forces.content)

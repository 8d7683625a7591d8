"""What the page shows, read from its texts without a browser."""

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


def test_service_that_is_gone_greys_the_page_within_half_a_second(service, page):
    panel = page._panel
    until(lambda: page._client.state_age_s < 0.5)
    until(lambda: "IDLE" in panel._mode.content and "0.412 N" in panel._force.content)
    assert not any(button.disabled for button in panel._moving_buttons)
    service.end()
    gone = time.monotonic()
    until(lambda: "not heard for" in panel._mode.content)
    assert time.monotonic() - gone < 1.0  # half a second, and what a busy machine adds
    until(lambda: panel._force.content == "unknown")
    assert "last mode IDLE" in panel._mode.content
    until(lambda: all(button.disabled for button in panel._moving_buttons))
    until(lambda: page._scene._stale)


def test_curves_carry_the_names_of_the_sections_of_the_estimate(service, page):
    panel = page._panel
    until(lambda: panel._force_plot is not None)
    labels = [series["label"] for series in panel._force_plot.series[1:]]
    assert labels == ["intermediate [N]", "tip [N]"]
    # Both axes of the covariance are 1e-3 N^2: 0.032 N along each, not the 0.045 N of their sum.
    assert "± 0.032" in panel._force.content

"""Twelve seconds of faults, stalled clients and recordings beside a running service."""

import pytest

from acceptance.soak_run import Soak, SoakSettings, restarts

pytestmark = pytest.mark.timeout(240)
SECONDS = 12.0
GROWTH_PERCENT = 10.0


def test_twelve_seconds_lose_no_reply_and_leave_every_recording_readable(tmp_path):
    often = {"fault_every_s": 3.0, "visitor_every_s": 2.5, "recording_s": 5.0}
    # The rod leaves the processor to what is tested; the live tests run on the elements.
    figures = Soak(SoakSettings(tmp_path, SECONDS, "rod", 1, **often), lambda _: None).run().figures
    assert (figures["replies_lost"], figures["recordings_unreadable"]) == (0, 0), figures
    assert figures["service_ended"] == "no"
    assert figures["recordings"] >= 2
    assert figures["device_faults"] >= 3
    assert figures["control_growth_percent"] < GROWTH_PERCENT
    assert figures["estimator_growth_percent"] < GROWTH_PERCENT


def test_a_restart_is_one_line_of_the_services_log(tmp_path):
    log = tmp_path / "service.log"
    log.write_text(
        "WARNING worker: the estimator was at one request for more than 5 s; it is killed\n"
        "WARNING worker: the estimator died (1 of 6 within 600 s); it is restarted in 0.1 s\n"
        "INFO reporting: bend: no longer unplugged\n"
    )
    assert restarts(log) == 1

"""The parts of ``softarm bench drivers`` that need no second process, in small."""

from mmap import mmap

import pytest

from acceptance import driver_decoding, driver_wire
from acceptance.driver_decoding import DecodingCase, against_qtm_rt, cases, load, zero_size_header


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.device)
def test_every_driver_takes_its_load(case):
    row = load(case, 300)
    assert row["readings"] == 300
    assert 0 < row["us_per_reading"] < 1e5
    assert row["readings_per_s"] == pytest.approx(1e6 / row["us_per_reading"])


def test_a_leak_shows():
    kept = []

    def leak(count):
        for _ in range(count):
            kept.append(mmap(-1, 1 << 16))  # the heap may have room from before, which would hide it
            kept[-1].write(bytes(1 << 16))

    assert load(DecodingCase("leaky", "64 kibibytes", leak), 1000)["memory_growth_kib"] > 60_000


def test_both_clients_decode_the_same_stream():
    rows = {row["client"]: row for row in against_qtm_rt(5000)}
    assert rows["qtm_rt"]["times_faster"] == pytest.approx(1.0)
    assert rows["this project"]["times_faster"] > 0.0


def test_a_header_of_size_zero_costs_nothing(monkeypatch):
    monkeypatch.setattr(driver_decoding, "_theirs", lambda: None)
    (ours,) = zero_size_header()
    assert ours["outcome"].startswith("refused")
    assert ours["seconds"] < 0.1


async def test_a_driver_is_connected_to_fakes_in_a_process_of_their_own(tmp_path):
    gauge = [subject for subject in driver_wire.subjects() if subject.name == "gauge"]
    async with driver_wire.connected(tmp_path, gauge) as bench:
        await driver_wire.until_alive(bench.devices["gauge"], "gauge")
    assert bench.watches["gauge"].readings > 0

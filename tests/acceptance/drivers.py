"""``softarm bench drivers``: rates, round trips, reconnection, decoding and memory of the device drivers."""

import asyncio
import logging
import tempfile
from pathlib import Path

import click

from acceptance import driver_decoding, driver_wire
from acceptance.driver_wire import DeviceUnderTest
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table

FASTEST_HZ = 500.0
READINGS = driver_decoding.MILLION
QUICK_READINGS = 20_000
SECONDS = 10.0
QUICK_SECONDS = 2.0


@click.command()
@json_option
@quick_option
def command(as_json: bool, quick: bool) -> int:
    """Time and load the device drivers against the fakes, which run in a process of their own.

    Example: softarm bench drivers --quick
    """
    # The outages are meant; the drivers' warnings of them would only stand between the tables.
    logging.getLogger("softarm.drivers").setLevel(logging.ERROR)
    seconds, readings = (QUICK_SECONDS, QUICK_READINGS) if quick else (SECONDS, READINGS)
    with progress("drivers on the wire"):
        wire = asyncio.run(on_the_wire(seconds))
    cases = driver_decoding.cases()
    with progress("drivers under load", len(cases)) as advance:
        loads = []
        for case in cases:
            loads.append(driver_decoding.load(case, readings))
            advance(1)
    decoding = Table(
        "Readings in memory",
        loads,
        (
            "From bytes or words to the sink, on one core, without a socket.",
            "Memory: growth of the resident set over the readings, after a tenth as many to warm up.",
        ),
    )
    show(*wire, decoding, *qualisys(readings), as_json=as_json)
    return 0


async def on_the_wire(seconds: float) -> tuple[Table, ...]:
    """Measure over real sockets and terminals."""
    chosen = driver_wire.subjects()
    with tempfile.TemporaryDirectory(prefix="softarm-bench-") as folder:
        async with driver_wire.connected(Path(folder), chosen) as bench:
            await asyncio.sleep(1.0)
            rates = await driver_wire.sustained(bench, seconds)
            returns = await driver_wire.outages(bench, chosen)
    fastest = await _fastest(chosen[:1], seconds)
    return (
        Table("Drivers on the wire", rates, ("Each at its device's own rate, all at once.",)),
        Table("Valve bank at its fastest", fastest, (f"Requested: {FASTEST_HZ:g} passes a second.",)),
        Table(
            "Coming back",
            returns,
            (
                f"Outage: the device is gone for {driver_wire.OUTAGE_S:g} s; time from its return "
                "to the next valid reading.",
                "Restart: the fakes' process ends and starts again; time from its ports being open.",
            ),
        ),
    )


async def _fastest(valves: list[DeviceUnderTest], seconds: float) -> list[dict[str, Cell]]:
    with tempfile.TemporaryDirectory(prefix="softarm-bench-") as folder:
        async with driver_wire.connected(Path(folder), valves, rate_hz=FASTEST_HZ) as bench:
            await asyncio.sleep(0.5)
            return await driver_wire.sustained(bench, seconds)


def qualisys(packets: int) -> tuple[Table, ...]:
    """Compare with the public Qualisys client in the same run."""
    return (
        Table(
            "Qualisys packets, compared with qtm_rt",
            driver_decoding.against_qtm_rt(packets),
            ("From the stream to position and rotation of three bodies; best of the rounds.",),
        ),
        Table(
            "A packet header of size zero",
            driver_decoding.zero_size_header(),
            ("What a hostile or desynchronised peer costs the event loop.",),
        ),
    )

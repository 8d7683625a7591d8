"""Offline recordings of the fake arm: run a manoeuvre, see it with real-level instruments, write it down."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.chain import gravity_in_base
from softarm.fakes.plant.effects import Concealed, arm_effects, effect, filters
from softarm.fakes.plant.instruments import InstrumentQuality, Streams, observe
from softarm.fakes.plant.manoeuvre import SAMPLE, PlantManoeuvre
from softarm.fakes.plant.parameters import ArmParameters, Mount, sopra
from softarm.fakes.plant.run import Truth, perform
from softarm.fakes.plant.valve import ValveConstants, draw_valve, outlet


@dataclass(frozen=True)
class Laboratory:
    """One arm in one laboratory: everything but the manoeuvre and the noise of a run.

    Args:
        arm: Parameters of the arm without concealed effects.
        concealed: Effects in the arm, its valves and its sensors.
        instruments: How well is measured.
        streams: What is recorded.
        valve: The valves; drawn from the seed when left out.
        specimen: Name or path of the specimen, as the recording states it.
        session_start: Time since the laboratory was switched on at which the run begins [s]; warming and
            drifting go on from there.
    """

    arm: ArmParameters = field(default_factory=sopra)
    concealed: tuple[Concealed, ...] = ()
    instruments: InstrumentQuality = field(default_factory=InstrumentQuality)
    streams: Streams = field(default_factory=Streams)
    valve: ValveConstants | None = None
    specimen: str = "sopra"
    session_start: float = 0.0

    def mounted(self, mount: Mount) -> "Laboratory":
        """Return the same arm in another mount."""
        return replace(self, arm=replace(self.arm, mount=mount))


@dataclass(frozen=True)
class Generated:
    """A recording and what is behind it.

    Args:
        time: [s] from the start of the file, shape (samples,).
        columns: Canonical columns, each of shape (samples,).
        info: What a user would know (``recording.toml``).
        truth: What is concealed (``truth.toml``).
        run: The true motion.
    """

    time: Floats
    columns: dict[str, Floats]
    info: dict[str, Any]
    truth: dict[str, Any]
    run: Truth


def generate(laboratory: Laboratory, manoeuvre: PlantManoeuvre, seed: int) -> Generated:
    """Run a manoeuvre on a rested arm and record it.

    Args:
        laboratory: The arm and its instruments.
        manoeuvre: What is done.
        seed: Of the noise, the losses and, if not given, the valves; the rest is deterministic.

    Raises:
        InputError: A concealed effect is unknown or does not fit.
    """
    rng = np.random.default_rng(seed)
    concealed = laboratory.concealed
    arm = FakeArm(laboratory.arm, arm_effects(concealed), laboratory.session_start)
    valve = laboratory.valve or draw_valve(rng, arm.chambers)
    pressures = outlet(valve, manoeuvre.commands, filters(concealed, "valve"))
    run = perform(arm, manoeuvre, pressures)
    columns = observe(
        run, manoeuvre.commands, arm.sections, concealed, laboratory.instruments, laboratory.streams, rng
    )
    return Generated(
        run.time - run.time[0], columns, _info(laboratory, manoeuvre), _truth(concealed, seed), run
    )


def _info(laboratory: Laboratory, manoeuvre: PlantManoeuvre) -> dict[str, Any]:
    """Describe the run as a user knows it."""
    mount = laboratory.arm.mount
    pulled = sorted({pull.section for pull in manoeuvre.pulls})
    info: dict[str, Any] = {
        "specimen": laboratory.specimen,
        "rate_hz": 1.0 / SAMPLE,
        "pressure_source": "measured" if laboratory.streams.measured else "commanded",
        "manoeuvre": manoeuvre.name,
        "session_start_s": laboratory.session_start,
        "mount_position_m": list(mount.position),
        "mount_quaternion": list(mount.quaternion),
        "gravity_m_s2": [float(round(component, 9)) for component in gravity_in_base(laboratory.arm)],
        "source": "fake arm",
        "notes": "Made by a physics engine, not by an arm. Poses in the laboratory frame, z up.",
    }
    if pulled:
        info["gauge_section"] = pulled[0] if len(pulled) == 1 else pulled
    return info


def _truth(concealed: tuple[Concealed, ...], seed: int) -> dict[str, Any]:
    """Describe what is concealed."""
    return {"seed": seed, "effects": [describe(one) for one in concealed]}


def describe(concealed: Concealed) -> dict[str, Any]:
    """Return a concealed effect as a table: name, place, and all parameters with their units."""
    definition = effect(concealed.name)
    numbers: Mapping[str, float] = definition.numbers(concealed)
    return {
        "effect": concealed.name,
        "where": dict(concealed.where),
        "parameters": {
            name: {"value": value, "unit": definition.quantities[name].unit}
            for name, value in numbers.items()
        },
    }

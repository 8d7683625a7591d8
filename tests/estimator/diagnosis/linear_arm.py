"""An arm known in closed form as a model and, with other physics, as the arm that is recorded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.diagnosis.prepare import blocks_of
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Model
from softarm.estimator.effects import EFFECTS, Effect, Spot
from softarm.estimator.effects.augmented import PlacedEffect, simulate_with
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.simulation import Drive, LinearisedArm, Response
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import SEGMENTS, straight_arm, world

SECTIONS = ("intermediate", "tip")
Concealed = Sequence[tuple[str | Effect, Place, Sequence[float]]]
"""Effects by name, or of one's own, with their places and parameters."""
NOISE = 4e-4
STEP = 0.2


@dataclass(frozen=True)
class StraightArm:
    """The straight arm with stiffness factors of its segments, for any drive."""

    scales: tuple[float, float] = (1.0, 1.0)

    @property
    def segments(self):
        return SEGMENTS

    def respond(self, drive: Drive, near: Response | None = None, *, slopes: bool = True) -> Response:
        plain = straight_arm(drive.time)
        arm = LinearisedArm(SEGMENTS, plain.drive, plain.baseline)
        base = arm.respond(drive)
        if self.scales == (1.0, 1.0):
            return base
        size = np.array(self.scales)[:, None]
        return arm.respond(drive.plus(np.zeros_like(drive.wrenches), _couples(base, size)))


def _couples(base: Response, size: np.ndarray) -> np.ndarray:
    """Give the couples that shrink every strain by the stiffness factor."""
    return base.strains * (1.0 / size - 1.0) * world().stiffness


def model() -> Model:
    def arm(scales: Mapping[str, float], torsion: np.ndarray) -> StraightArm:
        return StraightArm((scales.get("upper", 1.0), scales.get("lower", 1.0)))

    return Model(load_specimen("sopra"), SECTIONS, arm)


def suite() -> SensorSuite:
    make = SpecimenSensors(load_specimen("sopra"), SECTIONS, Registration())
    return SensorSuite(tuple(make.bend(section) for section in SECTIONS))


def holds(seed: int, seconds: float = 45.0) -> np.ndarray:
    """Random pressures held for 3 s each, shape (samples, 6)."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(0.0, 40e3, (int(seconds / 3.0), 6)) * (rng.random((int(seconds / 3.0), 6)) < 0.6)
    levels[0] = 0.0
    return np.repeat(levels, round(3.0 / STEP), axis=0)


def session(
    name: str,
    seed: int,
    effects: Concealed = (),
    *,
    nominal: bool = False,
    scales: tuple[float, float] = (1.1, 0.93),
) -> Session:
    """Record an arm that is stiffer above, softer below, and creeps a little, with other effects."""
    pressures = holds(seed)
    time = np.arange(len(pressures)) * STEP + 100.0 * seed
    gravity = np.zeros((len(time), 3))
    background = [("viscoelastic_creep", Place(), (0.02, 5.0, 0.0))]
    placed = [
        PlacedEffect(
            effect if isinstance(effect, Effect) else EFFECTS[effect],
            Spot(world(("bend_intermediate", "bend_tip")), place),
            np.array(theta),
        )
        for effect, place, theta in [*background, *effects]
    ]
    sensors = suite()
    drive = Drive.of(time, pressures, gravity, 2, 2)
    found = simulate_with(
        placed, StraightArm(scales), world(("bend_intermediate", "bend_tip")), drive, sensors
    )
    readings = np.concatenate([found.readings[m.name] for m in sensors.measurements], axis=-1)
    noise = np.random.default_rng([seed, 1]).normal(0.0, NOISE, readings.shape)
    return Session(
        name,
        nominal,
        time,
        pressures,
        gravity,
        np.zeros((len(time), 2, 6)),
        sensors,
        readings + noise,
        np.full(sensors.size, NOISE),
        blocks_of(time),
        np.zeros(len(time), dtype=bool),
    )


def trial(effects: Concealed) -> list[Session]:
    """Two nominal recordings and four in question."""
    known = [session(f"nominal_{k}", k, nominal=True) for k in range(2)]
    return [*known, *(session(f"run_{k}", 10 + k, effects) for k in range(4))]

"""An arm known in closed form as a model and, with other physics, as the arm that is recorded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from softarm.estimator.calibration.setting import Setting
from softarm.estimator.diagnosis.prepare import blocks_of
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Model
from softarm.estimator.effects import EFFECTS, Effect, Spot
from softarm.estimator.effects.effect import Memory, Signals
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.effects.simulate import simulate_with
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.sensing import ActuationMap, Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.simulation import Drive, LinearisedArm, SimulatedArm, section_loads
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import SEGMENTS, straight_arm, world

SECTIONS = ("intermediate", "tip")
Concealed = Sequence[tuple[str | Effect, Place, Sequence[float]]]
"""Effects by name, or of one's own, with their places and parameters."""
NOISE = 4e-4
STEP = 0.2


def _lock(signals: Signals, theta: np.ndarray, spot: Spot, memory: Memory) -> tuple[np.ndarray, Memory]:
    """Let a segment bend ``theta[1]`` less than it would of all that is beyond ``theta[0]`` rad."""
    start, lost = theta
    bend = np.linalg.norm(signals.strains[..., :2], axis=-1, keepdims=True)
    left = 1.0 - lost * np.maximum(bend - start, 0.0) / np.maximum(bend, 1e-9)
    chosen = spot.segments[:, None] > 0.0
    strains = signals.strains.copy()
    strains[..., :2] = np.where(chosen, strains[..., :2] * left, strains[..., :2])
    return strains, memory


LOCKING = replace(EFFECTS["material_stiffening"], act=_lock)
"""Physics that the library lacks."""


@dataclass(frozen=True)
class StraightModel:
    """The straight arm with stiffness factors of its segments, for any inputs; a ``BatchArmModel``."""

    scales: tuple[float, float] = (1.0, 1.0)

    sections, chambers, loads = SECTIONS, 6, section_loads(SECTIONS)
    regions = SEGMENTS.names
    takes_eigenstrains = True

    def with_scales(self, scales: Mapping[str, float]) -> "StraightModel":
        upper, lower = (scales.get(name, old) for name, old in zip(self.regions, self.scales, strict=True))
        return StraightModel((upper, lower))

    def evaluate(
        self, inputs: BatchInputs, *, start: ArmResponse | None = None, jacobians: bool = True
    ) -> ArmResponse:
        samples = len(inputs)
        drive = Drive.of(np.arange(samples, dtype=float), inputs.pressures, inputs.gravity, 2, 2)
        drive = replace(drive, wrenches=inputs.loads.reshape(drive.wrenches.shape))
        arm = _unloaded(samples)
        # A stiffer segment strains less by pressures, loads and gravity, but as much by eigenstrains.
        size = np.array(self.scales)[:, None]
        elastic = arm.respond(drive).strains / size
        free = np.zeros_like(elastic) if inputs.eigenstrains is None else inputs.eigenstrains
        response = arm.respond(replace(arm.drive, eigenstrains=elastic + free))
        by_strain = arm.baseline.eigenstrain_jacobian
        softened = np.linalg.lstsq(by_strain[0], arm.baseline.input_jacobian[0], rcond=None)[0]
        input_jacobian = by_strain[0] @ (softened / np.repeat(size, 4)[:, None])
        by_factor = -np.einsum("trgk,tgk->trg", by_strain.reshape(samples, -1, 2, 4), elastic)
        return replace(
            response, input_jacobian=np.tile(input_jacobian, (samples, 1, 1)), factor_jacobian=by_factor
        )


@cache
def _unloaded(samples: int) -> LinearisedArm:
    return straight_arm(np.arange(samples, dtype=float))


def model(specimen: Specimen | None = None) -> Model:
    return Model(specimen or load_specimen("sopra"), StraightModel(), SEGMENTS)


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
    setting: Setting | None = None,
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
    stretched = (setting or Setting({}, ActuationMap(np.ones(6), np.zeros(6)))).model(StraightModel(scales))
    arm = SimulatedArm(stretched, SEGMENTS)
    found = simulate_with(placed, arm, world(("bend_intermediate", "bend_tip")), drive, sensors)
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
    return [_nominal(0), _nominal(1), *(session(f"run_{k}", 10 + k, effects) for k in range(4))]


@cache
def _nominal(number: int) -> Session:
    return session(f"nominal_{number}", number, nominal=True)

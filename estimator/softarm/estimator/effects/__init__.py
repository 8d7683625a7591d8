"""Physical effects that may be missing from a model; each is one file of this package."""

from softarm.estimator.effects import (
    base_compliance,
    base_tilt,
    chamber_crosstalk,
    chamber_gain,
    contact_obstacle,
    distributed_mass,
    external_force,
    fibre_twist,
    frame_misalignment,
    hysteresis,
    inertia_damping,
    line_lag,
    line_leak,
    local_stiffness_defect,
    material_softening,
    material_stiffening,
    mullins_softening,
    pressure_bias,
    pressure_saturation,
    segment_stiffness,
    sensor_bias,
    sensor_drift,
    sensor_latency,
    sensor_scale,
    sensor_stuck,
    tether_stiffness,
    thermal_drift,
    tip_payload,
    valve_deadband,
    viscoelastic_creep,
)
from softarm.estimator.effects.effect import Effect, Memory, Parameter, Signals, describe
from softarm.estimator.effects.world import Spot, World

_MODULES = (
    base_compliance,
    base_tilt,
    chamber_crosstalk,
    chamber_gain,
    contact_obstacle,
    distributed_mass,
    external_force,
    fibre_twist,
    frame_misalignment,
    hysteresis,
    inertia_damping,
    line_lag,
    line_leak,
    local_stiffness_defect,
    material_softening,
    material_stiffening,
    mullins_softening,
    pressure_bias,
    pressure_saturation,
    segment_stiffness,
    sensor_bias,
    sensor_drift,
    sensor_latency,
    sensor_scale,
    sensor_stuck,
    tether_stiffness,
    thermal_drift,
    tip_payload,
    valve_deadband,
    viscoelastic_creep,
)

EFFECTS: dict[str, Effect] = {module.EFFECT.name: module.EFFECT for module in _MODULES}
"""Every effect by its name in the vocabulary; ``unknown`` has no physics and is not among them."""

__all__ = ["EFFECTS", "Effect", "Memory", "Parameter", "Signals", "Spot", "World", "describe"]

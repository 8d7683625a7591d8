"""Physical effects that may be missing from a model; each is one file of this package."""

from importlib import import_module

from softarm.estimator.effects.effect import Effect, Memory, ModalChange, Parameter, Signals, describe
from softarm.estimator.effects.world import Spot, World

_FILES = (
    "base_compliance",
    "base_tilt",
    "chamber_crosstalk",
    "chamber_gain",
    "contact_obstacle",
    "distributed_mass",
    "external_force",
    "fibre_twist",
    "frame_misalignment",
    "hysteresis",
    "inertia_damping",
    "line_lag",
    "line_leak",
    "local_stiffness_defect",
    "material_softening",
    "material_stiffening",
    "mullins_softening",
    "pressure_bias",
    "pressure_saturation",
    "segment_stiffness",
    "sensor_bias",
    "sensor_drift",
    "sensor_latency",
    "sensor_scale",
    "sensor_stuck",
    "tether_stiffness",
    "thermal_drift",
    "tip_payload",
    "valve_deadband",
    "viscoelastic_creep",
)
"""Files of this package that hold an effect: adding one is its file and a line here."""

EFFECTS: dict[str, Effect] = {
    effect.name: effect for effect in (import_module(f"{__name__}.{file}").EFFECT for file in _FILES)
}
"""Every effect by its name in the vocabulary; ``unknown`` has no physics and is not among them."""

__all__ = [
    "EFFECTS",
    "Effect",
    "Memory",
    "ModalChange",
    "Parameter",
    "Signals",
    "Spot",
    "World",
    "describe",
]

"""Physical effects accepted into a specimen, and the vocabulary that names them."""

from typing import Literal

from softarm.estimator.specimen.entry import Entry, Finite, Name, NotNegative

EffectName = Literal[
    "viscoelastic_creep",
    "hysteresis",
    "mullins_softening",
    "material_softening",
    "material_stiffening",
    "segment_stiffness",
    "local_stiffness_defect",
    "inertia_damping",
    "tip_payload",
    "external_force",
    "contact_obstacle",
    "distributed_mass",
    "base_tilt",
    "base_compliance",
    "tether_stiffness",
    "chamber_gain",
    "chamber_crosstalk",
    "pressure_bias",
    "pressure_saturation",
    "line_lag",
    "line_leak",
    "valve_deadband",
    "frame_misalignment",
    "sensor_bias",
    "sensor_drift",
    "sensor_scale",
    "sensor_latency",
    "sensor_stuck",
    "thermal_drift",
    "fibre_twist",
    "swapped_channels",
    "frame_mismatch",
    "event",
    "unknown",
]


class Place(Entry):
    """Where an effect acts; what does not apply is left out."""

    segment: Name | None = None
    """Soft segment."""
    section: Name | None = None
    """Rigid section."""
    chamber: int | None = None
    """Chamber's index."""
    sensor: str | None = None
    """Sensor or column."""
    axis: str | None = None
    """Axis of the sensor or of the base frame."""


class Parameter(Entry):
    """A parameter of an effect."""

    value: Finite
    """Best value."""
    std: NotNegative
    """Standard deviation."""
    unit: str
    """Unit of both, ``1`` for none."""


class Physics(Entry):
    """An effect that the model contains beyond its description, with where it came from."""

    effect: EffectName
    """Name of the effect in the vocabulary."""
    where: Place = Place()
    """Where it acts."""
    parameters: dict[Name, Parameter]
    """Its parameters by name."""
    recordings: tuple[str, ...] = ()
    """Recordings that the values came from."""

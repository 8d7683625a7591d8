"""All effects by name, and how they are put into an arm or in front of a signal."""

from softarm.estimator.errors import InputError
from softarm.fakes.plant.effects.arm import (
    base_compliance,
    base_tilt,
    chamber_crosstalk,
    chamber_gain,
    contact_obstacle,
    distributed_mass,
    external_force,
    fibre_twist,
    hysteresis,
    inertia_damping,
    line_lag,
    line_leak,
    local_stiffness_defect,
    material_softening,
    material_stiffening,
    mullins_softening,
    segment_stiffness,
    tether_stiffness,
    thermal_drift,
    tip_payload,
    viscoelastic_creep,
)
from softarm.fakes.plant.effects.effect import ArmEffect, Concealed, ConcealedEffect, Filter, InstrumentEffect
from softarm.fakes.plant.effects.foreign import (
    curvature_area,
    curvature_locking,
    periodic_disturbance,
    product_coupling,
    random_law,
    swirl,
    wall_buckling,
)
from softarm.fakes.plant.effects.instrument import (
    frame_misalignment,
    pressure_bias,
    pressure_saturation,
    sensor_bias,
    sensor_drift,
    sensor_latency,
    sensor_scale,
    sensor_stuck,
    valve_deadband,
)
from softarm.fakes.plant.parameters import ArmParameters

ARM_EFFECTS: dict[str, ArmEffect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        base_compliance,
        base_tilt,
        chamber_crosstalk,
        chamber_gain,
        contact_obstacle,
        distributed_mass,
        external_force,
        fibre_twist,
        hysteresis,
        inertia_damping,
        line_lag,
        line_leak,
        local_stiffness_defect,
        material_softening,
        material_stiffening,
        mullins_softening,
        segment_stiffness,
        tether_stiffness,
        thermal_drift,
        tip_payload,
        viscoelastic_creep,
    )
}
FOREIGN_EFFECTS: dict[str, ArmEffect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        curvature_area,
        curvature_locking,
        periodic_disturbance,
        product_coupling,
        random_law,
        swirl,
        wall_buckling,
    )
}
INSTRUMENT_EFFECTS: dict[str, InstrumentEffect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        frame_misalignment,
        pressure_bias,
        pressure_saturation,
        sensor_bias,
        sensor_drift,
        sensor_latency,
        sensor_scale,
        sensor_stuck,
        valve_deadband,
    )
}


def effect(name: str) -> ConcealedEffect:
    """Find an effect by its name.

    Raises:
        InputError: There is none.
    """
    for effects in (ARM_EFFECTS, FOREIGN_EFFECTS, INSTRUMENT_EFFECTS):
        if name in effects:
            return effects[name]
    known = ", ".join((*ARM_EFFECTS, *INSTRUMENT_EFFECTS, *FOREIGN_EFFECTS))
    raise InputError(f"effect '{name}'", "unknown", f"one of {known}")


def apply(arm: ArmParameters, concealed: tuple[Concealed, ...]) -> ArmParameters:
    """Put effects into an arm, one after another.

    Raises:
        InputError: One of them does not live in the arm, or its parameters or place do not fit.
    """
    for one in concealed:
        known = effect(one.name)
        if not isinstance(known, ArmEffect):
            raise InputError(
                f"effect '{one.name}'", "acts in an instrument", "conceal it in the signal's filter"
            )
        arm = known.change(arm, one.where, known.numbers(one))
    return arm


def arm_effects(concealed: tuple[Concealed, ...]) -> tuple[Concealed, ...]:
    """Choose those that live in the arm."""
    return tuple(one for one in concealed if isinstance(effect(one.name), ArmEffect))


def filters(concealed: tuple[Concealed, ...], signal: str, sensor: str | None = None) -> tuple[Filter, ...]:
    """Make the filters of one signal.

    Args:
        concealed: Effects, those of the arm included.
        signal: ``valve``, ``pose``, ``bend`` or ``gauge``.
        sensor: Name of the sensor, such as ``frame_tip``; an effect without a sensor acts on all of its kind.
    """
    made = []
    for one in concealed:
        known = effect(one.name)
        if isinstance(known, InstrumentEffect) and signal in known.signals:
            numbers = known.numbers(one)
            if one.where.get("sensor") in (None, sensor):
                made.append(known.make(signal, one.where, numbers))
    return tuple(made)

"""What a physical effect is: where it may act, its parameters, and how it enters the model.

Every effect is a pure function of signals over a stretch of time and of the memory that the stretch before
left behind, so one function serves whole recordings and a live service that steps from instant to instant.
An effect whose amplitudes are zero changes nothing.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.amounts import Amount
from softarm.estimator.effects.springs import Springs
from softarm.estimator.effects.world import Spot, World
from softarm.estimator.specimen.physics import EffectName, Place

Hook = Literal["command", "pressure", "gravity", "support", "load", "constitutive", "sensing"]
Memory = tuple[Floats, ...]
"""Internal state after the last sample, empty before the first."""

Excitation = Literal[
    "rest",
    "pressure_steps",
    "holds",
    "two_rates",
    "two_amplitudes",
    "growing_cycles",
    "large_pressures",
    "small_pressures",
    "each_chamber",
    "mount_turned",
    "long_run",
    "motion",
]


@dataclass(frozen=True)
class Signals:
    """What an effect sees over a stretch of time.

    Args:
        time: Seconds, shape (samples,).
        pressures: Gauge pressures [Pa], before the effect where it acts on them, shape (samples, chambers).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (samples, 3).
        strains: Generalised strains of the segments that would be without the effect, shape (samples,
            segments, 4).
        positions: Origins of the sections [m], shape (samples, sections, 3).
        rotations: Rotations of the sections, shape (samples, sections, 3, 3).
        moment: Moment of all loads about the base [N m], shape (samples, 3).
        reading: Predicted reading of the effect's sensor, of a bend sensor without its offset, shape
            (samples, size).
    """

    time: Floats
    pressures: Floats
    gravity: Floats
    strains: Floats
    positions: Floats
    rotations: Floats
    moment: Floats
    reading: Floats


@dataclass(frozen=True)
class ParameterSpec:
    """A number of an effect.

    Args:
        name: Its name in reports and specimen files.
        unit: Its unit, ``1`` for none.
        typical: A size that would matter; where a fit may start.
        lower: Lower bound.
        upper: Upper bound.
        role: An ``amplitude`` of zero means that the effect is absent; a ``shape`` has no such value.
        transform: Scale on which it is fitted and its prior is normal; ``inverse`` is for a stiffness
            that may be far above that of the arm, for its yielding is what shows.
        spread: Standard deviation of the prior, about 0 for a linear amplitude, else about ``typical``, in
            the unit or, on the log scale, in natural logarithms.
        alone: Plainer effect of the same amplitude that this one is by itself.
        dissipates: Whether a material with less than none of it would give off energy.
        periodic: Whether it is a direction: a fit may go once around, its value is from -pi to pi.
        least_drawn: Lower bound where no recording shows the arm in its known state: what a drawing of it can
            be wrong by.
        choices: The only values that a shape can have: each is a law of its own, and no fit moves it.
        of_marker: Its name in a report on a single marker, which has no angles; empty where it is the same.
    """

    name: str
    unit: str
    typical: float
    lower: float
    upper: float
    role: Literal["amplitude", "shape"] = "amplitude"
    transform: Literal["linear", "log", "inverse"] = "linear"
    spread: float = 1.0
    alone: EffectName | None = None
    dissipates: bool = False
    periodic: bool = False
    least_drawn: float | None = None
    choices: tuple[float, ...] = ()
    of_marker: str = ""

    @property
    def scale(self) -> float:
        """Size of a value that is 1 on its scale, unless that is logarithmic."""
        return abs(self.typical) or self.spread or 1.0

    def scaled(self, value: float) -> float:
        """Express a value on the scale on which it is fitted."""
        if self.transform == "log":
            return math.log(max(value, 1e-12))
        return value / self.scale if self.transform == "linear" else self.scale / max(value, 1e-12)

    def value(self, scaled: float) -> float:
        """Return the value that is so much on its scale."""
        if self.transform == "log":
            return math.exp(scaled)
        if self.periodic:
            return math.remainder(scaled * self.scale, 2.0 * math.pi)
        return scaled * self.scale if self.transform == "linear" else self.scale / max(scaled, 1e-12)

    def slope(self, scaled: float) -> float:
        """Return the derivative of the value by what it is on its scale."""
        value = self.value(scaled)
        return {"log": value, "linear": self.scale, "inverse": -(value**2) / self.scale}[self.transform]

    def deviation(self, value: float, scaled: float) -> float:
        """Return the standard deviation of a value from that on its scale, in its unit.

        What may be rigid has a skewed distribution: half of what two deviations allow on its larger side, so
        that two of either reach as far.
        """
        if self.choices:
            return 0.0
        at = self.scaled(value)
        if self.transform == "inverse":
            rigid, soft = max(at - 2.0 * scaled, self.scaled(self.upper)), at + 2.0 * scaled
            return max(self.value(rigid) - value, value - self.value(soft)) / 2.0
        return abs(self.slope(at)) * scaled


@dataclass(frozen=True)
class ModalChange:
    """What an effect does to the slowest mode of a released arm.

    Args:
        added_mass: Mass added at the tip [kg].
        mass_ratio: Factor on the modal mass.
        stiffness_ratio: Factor on the modal stiffness.
        inertia_time: a [s]: the segments at its place have a^2 of their stiffness as more inertia.
        damping_time: d [s]: they have d of their stiffness as more damping.
        base_compliance: C [rad/(N m)], by which the base rotates under the moment on it.
        base_damping_time: d [s]: it has d / C of damping.
    """

    added_mass: float = 0.0
    mass_ratio: float = 1.0
    stiffness_ratio: float = 1.0
    inertia_time: float = 0.0
    damping_time: float = 0.0
    base_compliance: float = 0.0
    base_damping_time: float = 0.0

    @property
    def vibrates_alike(self) -> bool:
        """Whether an arm of the same stiffness vibrates as before."""
        masses = self.added_mass == 0.0 and self.mass_ratio == 1.0
        resisting = self.inertia_time == 0.0 and self.damping_time == 0.0
        return masses and resisting and self.base_compliance == 0.0


def no_modal_change(theta: Floats) -> ModalChange:  # noqa: ARG001
    """Return that the mode stays as it is. Functions of effects have names, so that they pickle."""
    return ModalChange()


def never_along_arm(theta: Floats) -> bool:  # noqa: ARG001
    """Return that an effect does more than stretch the arm."""
    return False


def no_rotation(theta: Floats) -> Floats:  # noqa: ARG001
    """Return that a recorded base hides no rotation, shape (3,)."""
    return np.zeros(3)


Act = Callable[[Signals, Floats, Spot, Memory], tuple[Floats, Memory]]
SpringLaw = Callable[[Signals, Floats, Spot], Springs]


@dataclass(frozen=True)
class Effect:
    """One physical effect.

    What ``act`` returns depends on the hook: ``pressure`` the new pressures (samples, chambers), as does
    ``command``, which acts before the pressure sensors and so not on measured pressures; ``gravity`` a change
    of gravity (samples, 3), ``support`` a rotation of the base (samples, 3), ``load`` wrenches on the
    sections (samples, sections, 6), ``constitutive`` the strains (samples, segments, 4) into which those
    without the effect turn, ``sensing`` the new reading.

    Args:
        name: Name in the vocabulary.
        hook: Where it enters the model.
        places: Gives the places where it may act.
        act: The effect itself, of signals, parameters, place and memory.
        statement: Plain sentence with the fields ``where`` and the parameters' names, in the forms of
            ``Amount``.
        marker_statement: The same for a single marker; empty where it is the same.
        source: Where the equation comes from.
        equivalence: Structural classes: effects that share one look alike to orientation and pressure.
        in_healthy_arms: Whether an arm that is well may have a little of it.
        needs: Excitation without which it cannot be tested.
        splits: Rival effect to the manoeuvre that distinguishes the two.
        when: What it depends on, in plain words.
        shapes: Sets of its shape parameters, in their order, at which it is tried.
        presences: Gives parameters at which an effect that is no small change of anything is tried as simply
            present, of its place and the highest recorded pressures [Pa].
        driven: Whether it can only show where a chamber at its place was pressurised.
        by_fit: Whether a fit finds it; else the readings themselves show it.
        springs: Gives the springs on one side that it consists of, of signals, parameters and place: how hard
            they push depends on how far they have moved the arm; ``None`` where it consists of none.
        changes_inertia: Whether it changes mass or support, and with them how the arm vibrates.
        modal: Gives what it does to the slowest mode of the arm, of its parameters.
        stiffness: Gives the factor on the stiffness of the segments at its place along a recording, shape
            (samples,), of the clock [s] and its parameters; ``None`` where they vibrate as before.
        only_vibrates: Whether how the arm vibrates is all that it changes where the model vibrates.
        along_arm: Gives whether it only stretches the arm, of its parameters.
        hidden_rotation: Gives the rotation of the base that a recorded base does not show [rad], shape (3,),
            of its parameters.
        hides_reading: Whether its sensor's reading no longer shows the state of the arm.
        shown_by_pressures: Whether a measured pressure shows it, so that it cannot act on one.
    """

    name: EffectName
    hook: Hook
    parameters: tuple[ParameterSpec, ...]
    places: Callable[[World], tuple[Place, ...]]
    act: Act
    statement: str
    source: str
    equivalence: tuple[str, ...] = ()
    in_healthy_arms: bool = True
    needs: frozenset[Excitation] = frozenset()
    splits: tuple[tuple[EffectName, str], ...] = ()
    when: str = "constant"
    marker_statement: str = ""
    shapes: tuple[tuple[float, ...], ...] = ((),)
    presences: Callable[[Spot, Floats], tuple[Floats, ...]] | None = None
    driven: bool = False
    by_fit: bool = True
    springs: SpringLaw | None = None
    changes_inertia: bool = False
    modal: Callable[[Floats], ModalChange] = no_modal_change
    stiffness: Callable[[Floats, Floats], Floats] | None = None
    only_vibrates: bool = False
    along_arm: Callable[[Floats], bool] = never_along_arm
    hidden_rotation: Callable[[Floats], Floats] = no_rotation
    hides_reading: bool = False
    shown_by_pressures: bool = False

    @property
    def responds_to_own_effect(self) -> bool:
        """Whether how far it pushes depends on how far it has moved the arm."""
        return self.springs is not None

    @property
    def typical(self) -> Floats:
        """Typical parameters, shape (parameters,)."""
        return np.array([parameter.typical for parameter in self.parameters])

    @property
    def detunes(self) -> bool:
        """Whether it changes how the arm, or what it stands on, vibrates: its stiffness or its damping."""
        material = self.hook == "constitutive" and not self.driven
        return material or self.modal(self.typical).base_compliance > 0.0

    @property
    def has_choices(self) -> bool:
        """Whether it acts by one of several laws."""
        return any(parameter.choices for parameter in self.parameters)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of the parameters that a fit moves: a choice between laws is none."""
        return sum(not parameter.choices for parameter in self.parameters)

    @property
    def neutral(self) -> Floats:
        """Parameters with which it does nothing, shape (parameters,)."""
        return np.array([0.0 if p.role == "amplitude" else p.typical for p in self.parameters])

    def against_drawing(self) -> "Effect":
        """Return it as it may act where nothing but a drawing of the arm is the reference."""
        parameters = tuple(
            p if p.least_drawn is None else replace(p, lower=p.least_drawn) for p in self.parameters
        )
        return replace(self, parameters=parameters)

    def unit(self, parameter: ParameterSpec, place: Place) -> str:
        """Return a parameter's unit at a place: what is an angle of other sensors is a length of a marker."""
        return parameter.unit.replace("rad", "m") if self._of_marker(place) else parameter.unit

    def reported(self, parameter: ParameterSpec, place: Place) -> str:
        """Return a parameter's name in a report on a place."""
        return parameter.of_marker if parameter.of_marker and self._of_marker(place) else parameter.name

    def _of_marker(self, place: Place) -> bool:
        return self.hook == "sensing" and (place.sensor or "").startswith("marker_")

    def sentence(self, theta: Floats, place: Place) -> str:
        """Describe the effect with these parameters at a place in one plain sentence."""
        values = {
            p.name: Amount(float(v), self.unit(p, place)) for p, v in zip(self.parameters, theta, strict=True)
        }
        statement = (
            self.marker_statement if self.marker_statement and self._of_marker(place) else self.statement
        )
        sentence = statement.format(where=describe(place), **values)
        return sentence[:1].upper() + sentence[1:]


def describe(place: Place) -> str:
    """Name a place in plain words: ``chamber 2``, ``the lower segment``, ``sensor bend_tip, axis x``."""
    named = place.model_dump(exclude_none=True)
    words = [f"the {v} {k}" if k in ("segment", "section") else f"{k} {v}" for k, v in named.items()]
    return ", ".join(words) or "the whole arm"

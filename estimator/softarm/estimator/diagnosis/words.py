"""Plain words for what effects depend on, and for the manoeuvre that separates two of them."""

from collections.abc import Iterable

from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import EffectName

EXCITATION: dict[str, str] = {
    "rest": "20 s at rest, vented",
    "pressure_steps": "steps of pressure",
    "holds": "holds of 10 s and more",
    "two_rates": "ramps at two rates",
    "two_amplitudes": "cycles of two amplitudes",
    "growing_cycles": "growing cycles on the rested arm",
    "large_pressures": "pressures above 60 % of the limit",
    "small_pressures": "pressures below 5 kPa",
    "each_chamber": "each chamber driven alone",
    "mount_turned": "the mount turned",
    "long_run": "a run of 10 minutes",
    "motion": "motion of the arm",
}
"""What recordings may lack, in words."""
WITHOUT_CHAMBERS: dict[str, str] = {
    "rest": "20 s at rest",
    **{need: EXCITATION[need] for need in ("mount_turned", "long_run", "motion")},
}
"""The same of an arm without chambers."""
PNEUMATIC = ("chamber", "pressure", "valve", "vent", "hose", "ramp", "hold")
"""Words that show that a manoeuvre needs chambers."""


def plain(name: str) -> str:
    """Write the name of an effect as words."""
    return name.replace("_", " ")


def dependence(when: str) -> str:
    """Return a clause on what a mismatch depends on."""
    if when == "constant":
        return "the mismatch is constant"
    return f"the mismatch varies with {when if when.startswith('time since') else f'the {when}'}"


def sentence_on(when: str) -> str:
    """Return ``dependence`` as a sentence."""
    words = dependence(when)
    return f"{words[:1].upper()}{words[1:]}."


def possible(needs: Iterable[str], *, pneumatic: bool) -> list[str]:
    """Return, in words and sorted, the excitation among some that an arm can be given.

    Args:
        needs: Keys of ``EXCITATION``.
        pneumatic: Whether the arm has chambers.
    """
    vocabulary = EXCITATION if pneumatic else WITHOUT_CHAMBERS
    return [vocabulary[need] for need in sorted(needs) if need in vocabulary]


def manoeuvre(one: EffectName, other: EffectName, *, pneumatic: bool = True) -> str:
    """Return the manoeuvre that separates two effects.

    Args:
        one: The effect that was found.
        other: Its rival.
        pneumatic: Whether the arm has chambers; where it has none, no pressures are asked for.
    """
    for first, second in ((one, other), (other, one)):
        for rival, words in EFFECTS[first].splits:
            if rival == second and (pneumatic or not any(word in words for word in PNEUMATIC)):
                return words
    needs = EFFECTS[other].needs - EFFECTS[one].needs or EFFECTS[other].needs
    return "; ".join(possible(needs, pneumatic=pneumatic)) or "a different kind of motion"

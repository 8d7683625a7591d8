"""Other arms of the same drawing: cast tolerances, another batch of rubber, another make of the fake."""

from dataclasses import dataclass, replace

import numpy as np

from softarm.fakes.plant.instruments import InstrumentQuality
from softarm.fakes.plant.parameters import Actuation, ArmParameters, Memory, PlantSegment, sopra

Random = np.random.Generator

SHEAR_TOLERANCE = 0.10
"""By how much a shear coefficient may be off the one that is drawn.

For the same pipe at Poisson's ratio 1/2, J. R. Hutchinson (J. Appl. Mech. 68, 2001, 87-92) has 7 to 10 % more
than Cowper, and neither covers lobes with three chambers.
"""


@dataclass(frozen=True)
class Variant:
    """One arm and its laboratory, drawn by a seed.

    Args:
        arm: Parameters.
        instruments: With the misalignment of the bodies' frames and the offset of the clocks.
    """

    arm: ArmParameters
    instruments: InstrumentQuality


def variant(
    seed: int, spread: float = 1.0, background: float = 1.0, plain: ArmParameters | None = None
) -> Variant:
    """Draw an arm.

    Args:
        seed: Which one; the same seed gives the same arm.
        spread: Scale of the tolerances and of the misalignments; 0 for the drawing.
        background: Scale of what every arm has of creep, hysteresis and cross-talk.
        plain: The arm as drawn; SoPrA when left out.
    """
    rng, shears = np.random.default_rng([seed, 20]), np.random.default_rng([seed, 21])
    plain = plain or sopra()
    segments = tuple(
        replace(
            _segment(rng, segment, spread, background),
            shear=segment.shear * (1.0 + SHEAR_TOLERANCE * spread * float(shears.uniform(-1.0, 1.0))),
        )
        for segment in plain.segments
    )
    arm = replace(
        plain,
        segments=segments,
        azimuths=_triple(np.array(plain.azimuths) + spread * rng.normal(0.0, np.radians(1.0), 3)),
        rigid_masses=tuple(mass * _about(rng, 0.01, spread) for mass in plain.rigid_masses),
        wall=plain.wall * _about(rng, 0.04, spread),
        fibre_depth=plain.fibre_depth * _about(rng, 0.10, spread),
        actuation=_actuation(rng, plain.actuation, spread, background),
        cord_stiffness=plain.cord_stiffness * _about(rng, 0.2, spread),
        damping_rise=spread * float(rng.choice([0.0, rng.uniform(0.5, 2.0)])),
    )
    instruments = InstrumentQuality(
        alignments=spread * rng.normal(0.0, np.radians([0.6, 0.6, 1.5]), (len(plain.frames), 3)),
        offset=spread * float(rng.uniform(-0.02, 0.02)),
    )
    return Variant(arm, instruments)


def _about(rng: Random, share: float, spread: float) -> float:
    """Draw a factor about one, within three standard deviations of ``share``."""
    return 1.0 + spread * share * float(np.clip(rng.normal(), -3.0, 3.0))


def _triple(values: np.ndarray) -> tuple[float, ...]:
    """Convert an array to plain numbers."""
    return tuple(float(value) for value in values)


def _segment(rng: Random, segment: PlantSegment, spread: float, background: float) -> PlantSegment:
    """Draw a segment: another batch of rubber in a mould of some tolerance."""
    radii = tuple(radius * _about(rng, 0.004, spread) for radius in segment.radii)
    return replace(
        segment,
        radii=(radii[0], radii[1]),
        mass=segment.mass * _about(rng, 0.01, spread),
        links=_links(rng, segment, spread),
        modulus=segment.modulus * _about(rng, 0.08, spread),
        exponent=segment.exponent + 0.6 * spread * float(rng.uniform(-1.0, 1.0)),
        torsion=segment.torsion * _about(rng, 0.1, spread),
        damping_time=segment.damping_time * _about(rng, 0.15, spread),
        memory=_memory(rng, segment.memory, spread, background),
    )


def _links(rng: Random, segment: PlantSegment, spread: float) -> int:
    """Draw the number of links; cross-sections that are given stand for one each."""
    drawn = int(rng.integers(6, 10)) if spread > 0.0 else segment.links
    return segment.links if segment.cross_sections else drawn


def _memory(rng: Random, memory: Memory, spread: float, background: float) -> Memory:
    """Draw what the rubber remembers: a spectrum of its own, and loops of its own width."""
    share = background * _about(rng, 0.2, spread)
    stretch = 10.0 ** (0.2 * spread * rng.uniform(-1.0, 1.0, len(memory.times)))
    widen = _about(rng, 0.2, spread)
    return replace(
        memory,
        relaxation=tuple(share * strength for strength in memory.relaxation),
        times=_triple(np.array(memory.times) * stretch),
        hysteresis=tuple(background * _about(rng, 0.2, spread) * s for s in memory.hysteresis),
        widths=tuple(widen * width for width in memory.widths),
    )


def _actuation(rng: Random, actuation: Actuation, spread: float, background: float) -> Actuation:
    """Draw the chambers: gains unequal by a few percent, a trace of cross-talk, lines of unlike length."""
    mixing = background * spread * rng.normal(0.0, 0.008, (len(actuation.gains),) * 2)
    np.fill_diagonal(mixing, 0.0)
    return replace(
        actuation,
        gains=tuple(gain * _about(rng, 0.03, spread) for gain in actuation.gains),
        crosstalk=tuple(_triple(row) for row in mixing),
        lags=tuple(lag * _about(rng, 0.2, spread) for lag in actuation.lags),
        growth=actuation.growth * _about(rng, 0.15, spread),
        narrowing=(actuation.narrowing[0] * _about(rng, 0.3, spread), actuation.narrowing[1]),
    )

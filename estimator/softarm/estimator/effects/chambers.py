"""Effects between the valves and the arm: what a pressure does, and how late."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
    whole_and_segments,
    whole_segments_and_chambers,
)
from softarm.estimator.simulation.filters import first_order


def chamber_crosstalk(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add a share of each pressure to the nearest chamber of every other segment, as if it bent that too."""
    (share,) = theta
    world = spot.world
    owner = np.array(world.chamber_segment)
    pressures = signals.pressures.copy()
    for source in np.flatnonzero(spot.chambers):
        direction = np.cos(world.chamber_azimuth - world.chamber_azimuth[source])
        for segment in set(world.chamber_segment) - {int(owner[source])}:
            target = int(np.argmax(np.where(owner == segment, direction, -np.inf)))
            pressures[:, target] += share * signals.pressures[:, source]
    return pressures, memory


CHAMBER_CROSSTALK = Effect(
    name="chamber_crosstalk",
    hook="pressure",
    parameters=(ParameterSpec("share", "1", 0.08, -1.0, 1.0, spread=0.1),),
    places=whole_segments_and_chambers,
    act=chamber_crosstalk,
    statement="Pressure in {where} also acts on the other segment: for each pascal, the nearest chamber "
    "there acts as if it had {share:number} Pa more.",
    source="Observed on a two-segment arm whose supply lines pass the upper segment",
    equivalence=("crosstalk_or_scale",),
    needs=frozenset({"each_chamber"}),
    splits=(("sensor_scale", "drive the lower segment alone, mount turned"),),
    when="pressure level",
    driven=True,
)


def chamber_gain(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Scale the pressures, for a chamber that acts more or less than described: p -> (1 + g) p."""
    (gain,) = theta
    return signals.pressures * (1.0 + gain * spot.chambers), memory


CHAMBER_GAIN = Effect(
    name="chamber_gain",
    hook="pressure",
    parameters=(ParameterSpec("gain", "1", 0.08, -0.9, 2.0, spread=0.1),),
    places=whole_and_chambers,
    act=chamber_gain,
    statement="Pressure in {where} has {gain:less|more} effect than in the model.",
    source="Virtual work of a pressure",
    equivalence=("uniform_gain", "leak_or_gain"),
    needs=frozenset({"each_chamber"}),
    splits=(
        ("local_stiffness_defect", "bend the arm by gravity, mount turned"),
        ("line_leak", "close the valve at pressure for 30 s"),
    ),
    when="pressure level",
    driven=True,
)


def fibre_twist(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add a twist t sum(p) of the segment's chambers: fibres wound at an angle turn pressure into torsion."""
    (angle,) = theta
    strains = signals.strains.copy()
    for segment in np.flatnonzero(spot.segments):
        inside = np.array(spot.world.chamber_segment) == segment
        strains[:, segment, 2] += angle * signals.pressures[:, inside].sum(axis=1)
    return strains, memory


FIBRE_TWIST = Effect(
    name="fibre_twist",
    hook="constitutive",
    parameters=(ParameterSpec("turn", "rad/Pa", 1e-06, -0.0001, 0.0001, spread=2e-06),),
    places=whole_and_segments,
    act=fibre_twist,
    statement="The fibres of {where} convert pressure into twist: {turn}.",
    source="F. Connolly, C. J. Walsh, K. Bertoldi, PNAS 114 (2017) 51",
    needs=frozenset({"motion"}),
    splits=(("frame_misalignment", "bends in two azimuths at one sum of pressures"),),
    when="pressure level",
    driven=True,
)


def line_lag(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Delay the pressures, as a long line does that fills slowly: tau p' = p_in - p."""
    (lag,) = theta
    late, memory = first_order(signals.time, signals.pressures, lag, memory)
    return np.where(spot.chambers, late, signals.pressures), memory


LINE_LAG = Effect(
    name="line_lag",
    hook="command",
    parameters=(ParameterSpec("lag", "s", 0.3, 0.0, 20.0, spread=0.5),),
    places=whole_and_chambers,
    act=line_lag,
    statement="Pressure arrives late in {where}: the line has a time constant of {lag}.",
    source="Isothermal filling through a restriction, linearised (ISO 6358)",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("inertia_damping", "compare with measured pressures, or release a weight"),
        ("sensor_latency", "compare with measured pressures"),
    ),
    when="rate",
    driven=True,
)


def line_leak(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Lose a share of each pressure through a leak behind a restriction.

    f q' = p_in - q fills the line, p = q - s z loses from it, tau z' = q - z: s is the share lost in a long
    hold. Where what leaks is the chamber itself, tau is short and p = (1 - s) q.
    """
    share, filling, lag = theta
    arrived, line = first_order(signals.time, signals.pressures, filling, memory[:3])
    start = memory[3:] or (signals.time[:1], arrived[0], np.zeros_like(arrived[0]))
    lost, loss = first_order(signals.time, arrived, lag, start)
    return np.where(spot.chambers, arrived - share * lost, signals.pressures), (*line, *loss)


LINE_LEAK = Effect(
    name="line_leak",
    hook="pressure",
    parameters=(
        ParameterSpec("share", "1", 0.1, 0.0, 0.95, spread=0.1),
        ParameterSpec("line", "s", 0.3, 0.0, 20.0, spread=0.5, alone="line_lag"),
        ParameterSpec("time_constant", "s", 5.0, 0.01, 500.0, "shape", "log", spread=2.5),
    ),
    places=whole_and_chambers,
    act=line_leak,
    statement="{where} leaks: a held pressure falls by {share:percent} with a time constant of "
    "{time_constant}, behind a line with one of {line}.",
    source="Two linear restrictions on one volume",
    equivalence=("leak_or_gain",),
    needs=frozenset({"holds"}),
    splits=(
        ("chamber_gain", "close the valve at pressure for 30 s"),
        ("viscoelastic_creep", "compare with measured pressures"),
    ),
    when="pressure level",
    shapes=((0.03,), (0.3,), (3.0,), (30.0,)),
    driven=True,
)

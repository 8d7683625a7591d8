"""Everything that defines one fake arm: the facts of SoPrA and the fake's own richer physics.

The facts (lengths, radii, masses, lay-out of the chambers) are those of the owners' public parameter files.
The constants of the material, the lines and the supports are the fake's own, chosen so that the arm bends,
swings and creeps like the recorded one; no estimator shares them. An effect is a change of these
parameters, so an arm with every concealed effect at zero strength is the arm without them.
"""

from dataclasses import dataclass, field

import numpy as np

from softarm.fakes.plant.cross_section import CrossSection

GRAVITY = 9.81


@dataclass(frozen=True)
class Memory:
    """What the rubber remembers: creep, hysteresis, softening on first stretch.

    Args:
        relaxation: Strength of each Maxwell branch over the long-term modulus.
        times: Time constant of each branch [s].
        hysteresis: Strength of each elastic-slip element over the modulus.
        widths: Strain at which each element slips.
        sharpness: Exponent of the slip: 2 is a smooth Bouc-Wen loop, 20 and above an exact stop operator.
        mullins: Largest loss of stiffness below the largest strain so far, 0 to 1.
        mullins_strain: Distance below that strain over which the loss builds up.
    """

    relaxation: tuple[float, ...] = (0.030, 0.020, 0.018)
    times: tuple[float, ...] = (0.06, 1.5, 25.0)
    hysteresis: tuple[float, ...] = (0.030, 0.015, 0.010)
    widths: tuple[float, ...] = (0.002, 0.012, 0.05)
    sharpness: float = 30.0
    mullins: float = 0.0
    mullins_strain: float = 0.04


@dataclass(frozen=True)
class Defect:
    """A patch of other stiffness, such as a glue seam or a bubble.

    Args:
        azimuth: Direction of its middle in the segment's frame [rad].
        width: Full angle it covers [rad].
        start: Where it begins, as a share of the segment's length.
        end: Where it ends.
        factor: Modulus of the patch over that of the rest.
    """

    azimuth: float
    width: float
    start: float
    end: float
    factor: float


@dataclass(frozen=True)
class PlantSegment:
    """One soft segment.

    Args:
        name: ``upper`` or ``lower``.
        start: Height of its first deforming cross-section [m].
        length: Deforming length [m].
        radii: Lobe radius at its start and its end [m].
        mass: Of the silicone, with its caps [kg].
        links: Elastic joints that make it up.
        modulus: Small-strain modulus along the arm [Pa].
        exponent: n of the stress E (stretch - stretch^-n) / (n + 1); 3 where windings keep the sides from
            narrowing.
        torsion: Shear modulus over modulus: of torsional stiffness over modulus times polar moment.
        shear: Shear coefficient over that of a round pipe of the same area and second moment.
        stiffening: Relative gain of stress at 20 % strain, growing with its square.
        softening: Relative loss of stress at 20 % strain, growing with its size.
        damping_time: Viscous force over elastic stiffness [s].
        memory: What its rubber remembers.
        defects: Patches of other stiffness.
        locking_curvature: Curvature from which it locks [1/m]; 0 for never.
        locking: Bending stiffness gained beyond it over that at rest.
        chambers: Its chambers, in the order of their azimuths.
        cross_sections: Cross-section at each link; lobes of ``radii`` when left out.
    """

    name: str
    start: float
    length: float
    radii: tuple[float, float]
    mass: float
    links: int = 8
    modulus: float = 400e3
    exponent: float = 3.0
    torsion: float = 0.22
    shear: float = 1.0
    stiffening: float = 0.0
    softening: float = 0.0
    damping_time: float = 0.018
    memory: Memory = Memory()
    defects: tuple[Defect, ...] = ()
    locking_curvature: float = 0.0
    locking: float = 0.0
    chambers: tuple[int, ...] = (0, 1, 2)
    cross_sections: tuple[CrossSection, ...] = ()


@dataclass(frozen=True)
class PlantFrame:
    """A rigid section: its name, and its frame at rest in the base frame [m], quaternion (w, x, y, z)."""

    name: str
    origin: tuple[float, float, float]
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Actuation:
    """How pressure at the valves becomes force in the arm; one entry per chamber.

    Args:
        gains: Effective area of each chamber over its drawing.
        crosstalk: Share of each chamber's pressure that acts in another place: row is the place, column the
            chamber whose pressure it is; zero on the diagonal.
        lags: First-order time constants of the lines [s].
        leak_rates: Rates at which a chamber loses pressure through its wall [1/s].
        growth: Relative growth of the effective area at 50 kPa, as the windings give way.
        narrowing: Relative loss of area per unit of stretch at the chamber, first and second order.
        twist: Torque per sum of pressure forces [m], from fibres wound at an angle.
        buckling_pressure: Pressure at which a wall snaps through [Pa]; 0 for never.
        buckling: Relative growth of the area once it has.
        product: Gain of a chamber per 50 kPa in its neighbours.
        random_law: Strength of a random law [Pa], 0 for none, and which one.
    """

    gains: tuple[float, ...] = (1.0,) * 6
    crosstalk: tuple[tuple[float, ...], ...] = ((0.0,) * 6,) * 6
    lags: tuple[float, ...] = (0.012, 0.012, 0.012, 0.018, 0.018, 0.018)
    leak_rates: tuple[float, ...] = (0.0,) * 6
    growth: float = 0.28
    narrowing: tuple[float, float] = (0.05, 0.0)
    twist: float = 0.0
    buckling_pressure: float = 0.0
    buckling: float = 0.0
    product: float = 0.0
    random_law: tuple[float, int] = (0.0, 0)


@dataclass(frozen=True)
class Support:
    """The clamp.

    Args:
        tilt: Rotation of the clamp in the mount about x and y [rad]; the base section's frame is the mount's.
        compliance: Rotation of the base plate per moment about x and y [rad/(N m)].
    """

    tilt: tuple[float, float] = (0.0, 0.0)
    compliance: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Payload:
    """A weight fixed to a section.

    Args:
        section: Which one.
        mass: [kg].
        offset: Its centre in the section's frame [m].
    """

    section: str
    mass: float
    offset: tuple[float, float, float] = (0.0, 0.0, 0.01)


@dataclass(frozen=True)
class ForceLoad:
    """A force on a section.

    Args:
        section: Which one.
        amplitude: In the laboratory frame [N].
        start: When it sets in [s].
        period: Of a sine that modulates it [s]; 0 for a constant force.
    """

    section: str
    amplitude: tuple[float, float, float]
    start: float = 0.0
    period: float = 0.0


@dataclass(frozen=True)
class Tether:
    """An elastic line from a section to a point of the laboratory, slack below its length.

    Args:
        section: Which one.
        anchor: Fixed end, in the rest frame of the arm [m].
        length: Length up to which it is slack [m].
        stiffness: Of the taut line [N/m].
    """

    section: str
    anchor: tuple[float, float, float]
    length: float
    stiffness: float


@dataclass(frozen=True)
class Obstacle:
    """A soft plane or cylinder beside the arm, in the rest frame of the arm.

    Args:
        kind: ``plane`` or ``cylinder``.
        point: On the plane, or on the cylinder's axis [m].
        direction: Outward normal of the plane, or the cylinder's axis.
        stiffness: [N/m].
        radius: Of the cylinder [m].
        friction: Coulomb coefficient.
    """

    kind: str
    point: tuple[float, float, float]
    direction: tuple[float, float, float]
    stiffness: float
    radius: float = 0.0
    friction: float = 0.3


@dataclass(frozen=True)
class Warming:
    """Change of the modulus with the temperature of the room and the arm.

    Args:
        change: Relative change of all moduli in the end; rubber stiffens as it warms.
        time: Time constant of the warm-up [s].
    """

    change: float = 0.0
    time: float = 600.0


@dataclass(frozen=True)
class Loads:
    """What the world does to the arm beyond the cord and the hand."""

    payloads: tuple[Payload, ...] = ()
    forces: tuple[ForceLoad, ...] = ()
    tethers: tuple[Tether, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()


@dataclass(frozen=True)
class Mount:
    """Where the arm is clamped: the base frame in the laboratory frame (z up).

    Args:
        position: Of the base frame's origin [m].
        quaternion: Rotates base to laboratory coordinates, (w, x, y, z). By default the arm hangs.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.6)
    quaternion: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0)


@dataclass(frozen=True)
class ArmParameters:
    """One fake arm.

    Args:
        segments: Soft segments from the base to the tip.
        frames: Frames of the rigid sections from the base to the tip, one more than segments.
        rigid_masses: Masses of the rigid parts below each segment [kg].
        rigid_lengths: Their lengths [m].
        azimuths: Of the chambers of a segment [rad].
        wall: Thickness of the chambers' outer wall [m].
        floor: Distance from the triangle's side to the chamber [m].
        fibre_depth: How deep in the wall the fibres lie [m]; the pressure acts on all they enclose.
        actuation: Pressure to force.
        support: The clamp.
        loads: What acts on the arm.
        warming: Change of the moduli in time.
        cord_stiffness: Of the gauge's cord and spring [N/m].
        cord_damping: Of the taut cord [N s/m].
        density_factor: Scale of the silicone's mass.
        damping_rise: How much more viscous the arm is at rest than in fast motion; a dying swing is damped
            ever more, as recorded on a silicone beam.
        damping_speed: Speed of the tip over which that goes [m/s].
        mount: Where it is clamped.
        step: Time step [s].
    """

    segments: tuple[PlantSegment, ...]
    frames: tuple[PlantFrame, ...] = (
        PlantFrame("base", (0.0, 0.0, 0.0)),
        PlantFrame("intermediate", (0.0, 0.0, 0.1405)),
        PlantFrame("tip", (0.0, 0.0, 0.276)),
    )
    rigid_masses: tuple[float, ...] = (0.020, 0.023)
    rigid_lengths: tuple[float, ...] = (0.021, 0.005)
    azimuths: tuple[float, ...] = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)
    wall: float = 0.002
    floor: float = 0.002
    fibre_depth: float = 0.0009
    actuation: Actuation = Actuation()
    support: Support = Support()
    loads: Loads = Loads()
    warming: Warming = Warming()
    cord_stiffness: float = 1500.0
    cord_damping: float = 1.0
    density_factor: float = 1.0
    damping_rise: float = 0.0
    damping_speed: float = 0.1
    mount: Mount = field(default_factory=Mount)
    step: float = 0.0025

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the rigid sections from the base to the tip."""
        return tuple(frame.name for frame in self.frames)

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Chambers of each segment."""
        return tuple(segment.chambers for segment in self.segments)

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return sum(map(len, self.groups))


def sopra() -> ArmParameters:
    """Describe the two-segment SoPrA arm (masses, lengths and radii of the owners' parameter files)."""
    upper = PlantSegment(
        "upper", start=0.010, length=0.120, radii=(0.0175, 0.0140), mass=0.160, modulus=390e3
    )
    lower = PlantSegment(
        "lower",
        start=0.151,
        length=0.120,
        radii=(0.0140, 0.0099),
        mass=0.082,
        modulus=490e3,
        chambers=(3, 4, 5),
    )
    return ArmParameters(segments=(upper, lower))

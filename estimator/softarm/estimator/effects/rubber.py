"""Effects of the material: how a segment strains under its load, and what it weighs."""

import numpy as np
from numba import njit
from scipy.special import erf

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ModalChange, ParameterSpec, Signals
from softarm.estimator.effects.world import Spot, World, everywhere, segments, whole_and_segments
from softarm.estimator.simulation.filters import first_order, second_order


def losses(strains: Floats, world: World) -> Floats:
    """Return the loss of stiffness at k = 1 of each strain, shape (..., segments, 4).

    It is that of rubber that softens with the square of its strain. With the stress E e (1 - c e^2) in every
    fibre of a thin ring of radius r and length l, strained by e = (d + t r sin) / l under the bend t and the
    elongation d, the integrals over the ring give with k = 3 c r^2 / 4 l^2 the moment K_b t (1 - k (t^2 + 4
    d^2 / r^2)) and the axial force K_a d (1 - k (2 t^2 + 4/3 d^2 / r^2)); the sums in brackets are the loss
    of bending and of axial stiffness.
    """
    bend = (strains[..., :2] ** 2).sum(axis=-1)
    stretch = (strains[..., 3] / world.radii) ** 2
    bending, axial = bend + 4.0 * stretch, 2.0 * bend + 4.0 / 3.0 * stretch
    return np.stack([bending, bending, bending, axial], axis=-1)


def of_rings(strains: Floats, radii: Floats) -> Floats:
    """Return the elongation over the radius and both bends, shape (..., segments, 3), of strains.

    Args:
        strains: Shape (..., segments, 4).
        radii: Of the segments as thin rings [m], shape (segments,).
    """
    return np.concatenate([strains[..., 3:] / radii[:, None], strains[..., :2]], axis=-1)


def with_rings(strains: Floats, rings: Floats, radii: Floats) -> Floats:
    """Return strains with the elongation and the bends of rings; see ``of_rings``."""
    changed = strains.copy()
    changed[..., :2], changed[..., 3:] = rings[..., 1:], radii[:, None] * rings[..., :1]
    return changed


def distributed_mass(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Scale gravity, for a density other than described: g -> g (1 + s)."""
    (change,) = theta
    return change * signals.gravity, memory


def distributed_mass_modal(theta: Floats) -> ModalChange:
    """Let all masses grow alike."""
    return ModalChange(mass_ratio=1.0 + float(theta[0]))


LIGHTEST = -0.15
"""Silicone rubbers have 970 to 1300 kg/m3, so an arm as drawn is at most so much
lighter."""
STRIPPED = -0.5
"""An arm that has lost hoses or fittings may be lighter still, but its walls stay: more than half of it."""


DISTRIBUTED_MASS = Effect(
    name="distributed_mass",
    hook="gravity",
    parameters=(ParameterSpec("change", "1", 0.1, STRIPPED, 2.0, spread=0.1, least_drawn=LIGHTEST),),
    places=everywhere,
    act=distributed_mass,
    statement="The mass of {where} is {change:lower|higher} than in the model.",
    source="Statics",
    equivalence=("weight", "uniform_gain"),
    needs=frozenset({"mount_turned"}),
    splits=(("tip_payload", "mount turned, or a known weight on and off"),),
    changes_inertia=True,
    modal=distributed_mass_modal,
)


def inertia_damping(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Let strain follow the load like an oscillator: a^2 x'' + d x' + x = u.

    a is the inverse of the undamped angular frequency and d the damping time; a = 0 leaves Kelvin-Voigt
    damping. One mode for all of the place: vibrations of a few hertz are of the arm's first bending mode. A
    model that vibrates itself has more inertia and damping instead, see ``ModalChange``.
    """
    inertia, damping = theta
    moving, memory = second_order(signals.time, signals.strains, inertia, damping, memory)
    return np.where(spot.segments[:, None], moving, signals.strains), memory


def inertia_damping_modal(theta: Floats) -> ModalChange:
    """Add inertia and damping in proportion to the stiffness of the material there."""
    inertia, damping = theta.tolist()
    return ModalChange(inertia_time=inertia, damping_time=damping)


INERTIA_DAMPING = Effect(
    name="inertia_damping",
    hook="constitutive",
    parameters=(
        ParameterSpec("inertia_time", "s", 0.02, 0.0, 0.2, spread=0.03),
        ParameterSpec("damping_time", "s", 0.1, 0.0, 2.0, spread=0.1),
    ),
    places=whole_and_segments,
    act=inertia_damping,
    statement="{where} moves with inertia and damping that the model leaves out: the inverse of its angular "
    "frequency is {inertia_time}, its damping time {damping_time}.",
    source="J. W. Strutt (Rayleigh), The Theory of Sound, 1877",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("line_lag", "release a weight, or compare with measured pressures"),
        ("sensor_latency", "two kinds of sensor on one motion"),
    ),
    when="rate",
    modal=inertia_damping_modal,
    only_vibrates=True,
)


def local_stiffness_defect(
    signals: Signals, theta: Floats, spot: Spot, memory: Memory
) -> tuple[Floats, Memory]:
    """Compute the strains of a segment that has a strip of another stiffness on one side.

    A fibre of a thin ring of radius r, at the angle p from the middle of the strip, stretches by d + r (a cos
    p + b sin p) under the elongation d, the bend a that makes the strip longer, and the bend b across. The
    ring resists (d / r, a, b) with diag(1, 1/2, 1/2); a strip of the width w takes away c times the integral
    over it of the products of (1, cos p, sin p). What is left bears the same load at other strains. Where the
    elongation is free, the share D of the bending stiffness about a is lost for the smaller root c of

        (D/2 - c J) (1 - c w) = c^2 I^2,    I = 2 sin(w/2),    J = (w + sin w) / 2.
    """
    depth, azimuth, width = theta
    radii = spot.world.radii
    bend = np.array([np.cos(azimuth), np.sin(azimuth)])
    across = np.array([-bend[1], bend[0]])
    strip = strip_integrals(width)
    linear = strip[1, 1] + 0.5 * depth * width
    root = np.sqrt(linear**2 - 2.0 * depth * (strip[1, 1] * width - strip[0, 1] ** 2))
    yielding = np.linalg.inv(RING - depth / (linear + root) * strip) @ RING - np.eye(3)
    strains = signals.strains
    along = np.stack([strains[..., 3] / radii, strains[..., :2] @ bend, strains[..., :2] @ across], axis=-1)
    more = along @ yielding.T
    extra = np.zeros_like(strains)
    extra[..., :2] = more[..., 1:2] * bend + more[..., 2:] * across
    extra[..., 3] = radii * more[..., 0]
    return strains + spot.segments[:, None] * extra, memory


FIBRES = np.array([(1.0, np.cos(p), np.sin(p)) for p in np.arange(24) * np.pi / 12.0])
"""Stretch of a thin ring's fibres by its elongation over the radius and by both bends, shape (24, 3)."""
SHARES = np.einsum("fi,fj->fij", FIBRES, FIBRES).reshape(len(FIBRES), 9) / len(FIBRES)
"""What each fibre adds to the stiffness of a ring, shape (24, 3 x 3)."""
YIELDING = FIBRES[::2].copy()
"""Fibres of a ring that softens evenly: half as many do."""
STRIP_WIDTH = 1.5
"""Width [rad] at which a defect is tried: a quarter of the circumference."""
RING = np.diag([1.0, 0.5, 0.5])
"""Stiffness of a thin ring against elongation over its radius and both bends, over the axial one."""


def strip_integrals(width: float) -> Floats:
    """Integrate the products of (1, cos p, sin p) over a strip about p = 0, shape (3, 3)."""
    lever, sine = 2.0 * np.sin(0.5 * width), np.sin(width)
    return np.array(
        [[width, lever, 0.0], [lever, 0.5 * (width + sine), 0.0], [0.0, 0.0, 0.5 * (width - sine)]]
    )


def local_stiffness_defect_modal(theta: Floats) -> ModalChange:
    """Weaken the stiffness."""
    return ModalChange(stiffness_ratio=1.0 - float(theta[0]))


LOCAL_STIFFNESS_DEFECT = Effect(
    name="local_stiffness_defect",
    hook="constitutive",
    parameters=(
        ParameterSpec("depth", "1", 0.2, -2.0, 0.9, spread=0.3),
        ParameterSpec(
            "azimuth", "rad", 0.5, -2.0 * np.pi, 2.0 * np.pi, "shape", "linear", spread=1.8, periodic=True
        ),
        ParameterSpec("width", "rad", STRIP_WIDTH, 0.2, np.pi, "shape", "log", spread=0.5),
    ),
    places=segments,
    act=local_stiffness_defect,
    statement="The wall of {where} is defective on one side, over {width} of its circumference: its bending "
    "stiffness about the axis at {azimuth} is {depth:higher|lower}, and it bends about that axis when it is "
    "stretched.",
    source="A ring of two materials, as beams in S. P. Timoshenko, Strength of Materials, Part I, 1930",
    needs=frozenset({"each_chamber"}),
    splits=(
        ("chamber_gain", "bend the arm by gravity, mount turned"),
        ("contact_obstacle", "mount turned by 90 degrees"),
    ),
    when="pose",
    shapes=tuple((float(angle), STRIP_WIDTH) for angle in np.radians(np.arange(-150.0, 181.0, 60.0))),
    modal=local_stiffness_defect_modal,
)


def material_softening(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Strain the fibres of the wall by more than in proportion to their stress: e = s (1 + k |s|^n).

    It is the law of Ramberg and Osgood in every fibre of a thin ring, s the strain of a linear fibre, as a
    bend: with n of 2 the leading term of Yeoh's law, with n of 1 a modulus that falls from the first strain
    on. Sections stay plane, so fibres that are stretched further soften more, and a ring that is bent and
    stretched bends and stretches by more than either would alone.
    """
    growth, exponent = theta
    softened = yielding(signals.strains, spot.world.radii, growth * spot.segments, exponent)
    return softened, memory


YIELD_STEPS = 3
"""Steps to the stresses of a ring that softens: each is of the secant stiffness at the stresses before."""


@njit(cache=True, nogil=True)
def yielding(strains: Floats, radii: Floats, growths: Floats, exponent: float) -> Floats:
    """Compute the strains of rings of fibres that soften; see ``material_softening``.

    Args:
        strains: Of linear rings under the same load, shape (samples, segments, 4).
        radii: Of the rings [m], shape (segments,).
        growths: k of each segment, shape (segments,).
        exponent: n.

    Returns:
        Shape (samples, segments, 4). Torsion grows as the mean compliance of the fibres does.
    """
    out = strains.copy()
    fibres = YIELDING.shape[0]
    stress, secant, ring = np.empty(fibres), np.empty(fibres), np.empty((3, 3))
    load, strained = np.empty(3), np.empty(3)
    for k in range(strains.shape[1]):
        if growths[k] == 0.0:
            continue
        for sample in range(len(strains)):
            load[0] = strains[sample, k, 3] / radii[k]
            load[1], load[2] = strains[sample, k, 0], strains[sample, k, 1]
            for f in range(fibres):
                stress[f] = YIELDING[f, 0] * load[0] + YIELDING[f, 1] * load[1] + YIELDING[f, 2] * load[2]
            load[1] *= 0.5
            load[2] *= 0.5
            mean = 1.0
            for _ in range(YIELD_STEPS):
                ring[:] = 0.0
                for f in range(fibres):
                    secant[f] = 1.0 / (1.0 + growths[k] * np.abs(stress[f]) ** exponent)
                    for i in range(3):
                        for j in range(3):
                            ring[i, j] += secant[f] * YIELDING[f, i] * YIELDING[f, j] / fibres
                mean = ring[0, 0]
                strained[:] = np.linalg.solve(ring, load)
                for f in range(fibres):
                    stretch = YIELDING[f, 0] * strained[0] + YIELDING[f, 1] * strained[1]
                    stress[f] = secant[f] * (stretch + YIELDING[f, 2] * strained[2])
            out[sample, k, 0], out[sample, k, 1] = strained[1], strained[2]
            out[sample, k, 2] = strains[sample, k, 2] / mean
            out[sample, k, 3] = radii[k] * strained[0]
    return out


MATERIAL_SOFTENING = Effect(
    name="material_softening",
    hook="constitutive",
    parameters=(
        ParameterSpec("growth", "1", 0.2, 0.0, 20.0, spread=0.5),
        ParameterSpec("exponent", "1", 1.5, 0.5, 3.0, "shape", "log", spread=0.4),
    ),
    places=whole_and_segments,
    act=material_softening,
    statement="The material of {where} softens with strain: at a bend of one radian its outermost fibres "
    "would strain {growth:percent} further than those of a linear material under the same stress. The effect "
    "grows with the stress to the power {exponent}.",
    source="W. Ramberg and W. R. Osgood, NACA Technical Note 902 (1943); O. H. Yeoh, Rubber Chem. Technol. "
    "66 (1993) 754",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("chamber_gain", "each chamber alone from small to large pressures"),
        ("mullins_softening", "the same cycles a second time"),
    ),
    when="pose",
    shapes=((1.0,), (2.0,)),
)


STEPS = 12


def material_stiffening(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Shrink large strains: eps (1 + k q(eps)) = u, q the gain of stiffness of ``losses``.

    It is solved by Newton steps for the logarithm of the factor by which each strain shrinks, strain by
    strain, with q of the step before.
    """
    (growth,) = theta
    factor = np.ones_like(signals.strains)
    for _ in range(STEPS):
        gain = growth * losses(signals.strains * factor, spot.world)
        # The gain goes with the square of the factors, so log(factor (1 + gain)) has this slope.
        slope = 1.0 + 2.0 * gain / (1.0 + gain)
        factor *= np.exp(-np.log(factor * (1.0 + gain)) / slope)
    factor = np.where(spot.segments[:, None], factor, 1.0)
    return signals.strains * factor, memory


MATERIAL_STIFFENING = Effect(
    name="material_stiffening",
    hook="constitutive",
    parameters=(ParameterSpec("growth", "1/rad2", 0.2, 0.0, 20.0, spread=0.5),),
    places=whole_and_segments,
    act=material_stiffening,
    statement="The material of {where} stiffens with strain: its stiffness grows by {growth:percent} at a "
    "bend of one radian, with the square of the bend, and with stretch.",
    source="Leading term of O. H. Yeoh, Rubber Chem. Technol. 66 (1993) 754",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("mullins_softening", "the same cycles a second time"),
        ("contact_obstacle", "reach one pose by different chambers"),
        ("valve_deadband", "two opposite chambers together"),
    ),
    when="pose",
)


def mullins_softening(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Soften the fibres of the wall below the largest strain so far (Mullins effect).

    The segment is a thin ring of fibres. A fibre loses the share s erf((M^2 - A^2) / (w^2 + M^2)) / erf(1)
    of its stiffness: A is a size of strain, as a bend, M the largest so far, s the strength and w a width. It
    is the law of Ogden and Roxburgh with the scale that Mars added, so that a fibre that returns from a large
    strain has lost s, however large that was. A^2 = (1 - i) e^2 + i E^2, with e the strain of the
    fibre itself, E^2 twice the mean square of all, and i the isotropy: at i = 0 an arm that has bent to one
    side is softer there and on the opposite side, and little softer across; at i = 1 it is softer all around.
    What remains of the ring bears the same load at other strains.
    """
    strength, width, isotropy = theta
    radii = spot.world.radii
    strains = of_rings(signals.strains, radii)
    own = (strains @ FIBRES.T) ** 2
    squares = (1.0 - isotropy) * own + 2.0 * isotropy * own.mean(axis=-1, keepdims=True)
    largest = np.maximum.accumulate(squares, axis=0)
    if memory:
        largest = np.maximum(largest, memory[0])
    lost = strength * spot.segments[:, None] * erf((largest - squares) / (width**2 + largest)) / erf(1.0)
    ring = RING - (lost @ SHARES).reshape(*lost.shape[:-1], 3, 3)
    softened = np.linalg.solve(ring, (strains @ RING)[..., None])[..., 0]
    return with_rings(signals.strains, softened, radii), (largest[-1],)


MULLINS_SOFTENING = Effect(
    name="mullins_softening",
    hook="constitutive",
    parameters=(
        ParameterSpec("strength", "1", 0.15, 0.0, 0.8, spread=0.2),
        ParameterSpec("width", "rad", 0.3, 0.02, 3.0, "shape", "log", spread=0.7),
        ParameterSpec("isotropy", "1", 0.5, 0.0, 1.0, "shape", spread=0.5),
    ),
    places=whole_and_segments,
    act=mullins_softening,
    statement="The material of {where} shows the Mullins effect: below the largest strain so far its "
    "stiffness is up to {strength:percent} lower, over a bend of {width}. Where a fibre of the wall softens "
    "is decided by its own strain, and to {isotropy:percent} by that of the whole section.",
    source="R. W. Ogden, D. G. Roxburgh, Proc. R. Soc. A 455 (1999) 2861; W. V. Mars, Tire Sci. Technol. "
    "32 (2004) 120; J. Diani, B. Fayolle, P. Gilormini, Eur. Polym. J. 45 (2009) 601",
    needs=frozenset({"growing_cycles"}),
    splits=(
        ("viscoelastic_creep", "growing cycles on the rested arm, repeated at once"),
        ("material_stiffening", "the same cycles a second time"),
    ),
    when="largest strain so far",
    shapes=((0.3, 0.0), (0.3, 1.0)),
)


def segment_stiffness(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Scale the strains of a segment of other stiffness, whatever causes the load: eps = u / (1 + e)."""
    (change,) = theta
    return signals.strains / (1.0 + change * spot.segments[:, None]), memory


def segment_stiffness_along(clock: Floats, theta: Floats) -> Floats:
    """Return the factor on the stiffness, the same at all times, shape (samples,)."""
    return np.full(len(clock), 1.0 + float(theta[0]))


def segment_stiffness_modal(theta: Floats) -> ModalChange:
    """Change the stiffness."""
    return ModalChange(stiffness_ratio=1.0 + float(theta[0]))


SEGMENT_STIFFNESS = Effect(
    name="segment_stiffness",
    hook="constitutive",
    parameters=(ParameterSpec("change", "1", 0.1, -0.8, 4.0, spread=0.2),),
    places=segments,
    act=segment_stiffness,
    statement="The stiffness of {where} is {change:lower|higher} than in the model.",
    source="Linear elasticity",
    equivalence=("uniform_gain",),
    needs=frozenset({"motion"}),
    splits=(("chamber_gain", "a known weight on and off"),),
    when="pose",
    modal=segment_stiffness_modal,
    stiffness=segment_stiffness_along,
)


def thermal_drift(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Let the modulus drift with the clock: E = E0 (1 + c (1 - exp(-t / tau))), eps = u E0 / E.

    A body that warms up to its surroundings nears their temperature exponentially (Newton's law of cooling).
    """
    factor = 1.0 / warmed_stiffness(signals.time, theta)[:, None, None]
    return np.where(spot.segments[:, None], factor * signals.strains, signals.strains), memory


def warmed_stiffness(clock: Floats, theta: Floats) -> Floats:
    """Return the modulus over that at the clock's start, shape (samples,); see ``thermal_drift``."""
    change, lasting = theta
    return np.asarray(1.0 + change * (1.0 - np.exp(-np.maximum(clock, 0.0) / lasting)))


THERMAL_DRIFT = Effect(
    name="thermal_drift",
    hook="constitutive",
    parameters=(
        ParameterSpec("change", "1", 0.1, -0.6, 2.0, spread=0.1),
        ParameterSpec("time_constant", "s", 400.0, 30.0, 20000.0, "shape", "log", 1.0),
    ),
    places=whole_and_segments,
    act=thermal_drift,
    stiffness=warmed_stiffness,
    statement="The stiffness of {where} drifts over the run, independent of load: in the end it is "
    "{change:lower|higher}, with a time constant of {time_constant}.",
    source="First-order temperature dependence of the modulus; Newton's law of cooling",
    needs=frozenset({"long_run"}),
    splits=(
        ("viscoelastic_creep", "repeat the first minutes after an hour"),
        ("sensor_drift", "return to zero pressure every few minutes"),
    ),
    when="time of the run",
    shapes=((150.0,), (600.0,), (3000.0,)),
)


def viscoelastic_creep(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add strain that grows after every step of load, and comes back after release.

    Kelvin-Voigt element in series with the elastic segment: eps = (u + g z) / (1 + r g), tau z' = u - z, with
    u the elastic strain of the model, g the relaxation strength and tau the retardation time. The stiffness
    of the model is that at once for r = 0 and that in the end for r = 1, when the arm has become more viscous
    by a Maxwell branch beside its spring. The relaxation strength is the delayed over the immediate
    compliance and equally the modulus of that branch over that of the spring (A. S. Nowick and B. S. Berry,
    Anelastic Relaxation in Crystalline Solids, 1972).

    An arm that has hung at rest has crept under what it bears at the start.
    """
    strength, lag, relaxed = theta
    late, memory = first_order(signals.time, signals.strains, lag, memory)
    changed = (signals.strains + strength * late) / (1.0 + relaxed * strength)
    share = spot.segments[:, None]
    return (1.0 - share) * signals.strains + share * changed, memory


VISCOELASTIC_CREEP = Effect(
    name="viscoelastic_creep",
    hook="constitutive",
    parameters=(
        ParameterSpec("strength", "1", 0.1, -0.5, 2.0, spread=0.2, dissipates=True),
        ParameterSpec("time_constant", "s", 20.0, 0.5, 500.0, "shape", "log", 1.5),
        ParameterSpec("relaxed", "1", 1.0, 0.0, 1.0, "shape", choices=(0.0, 1.0)),
    ),
    places=whole_and_segments,
    act=viscoelastic_creep,
    statement="The material of {where} creeps: after a step its strain grows by a further "
    "{strength:percent} of the immediate strain, with a time constant of {time_constant}. Its stiffness is "
    "that of the model {relaxed:=at once|in the end}.",
    source="W. N. Findley et al., Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976",
    equivalence=("memory_at_one_rate",),
    needs=frozenset({"holds"}),
    splits=(
        ("hysteresis", "ramps at two rates, then holds of three time constants"),
        ("thermal_drift", "repeat the hold after an hour of the same load"),
    ),
    when="time since a change",
    shapes=tuple((lag, relaxed) for lag in (0.7, 2.0, 6.0, 20.0, 60.0) for relaxed in (0.0, 1.0)),
)

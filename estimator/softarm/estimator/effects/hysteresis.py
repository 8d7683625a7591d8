"""Friction inside the material: hysteresis that is the same at every rate."""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.rubber import RING, YIELDING, of_rings, with_rings
from softarm.estimator.effects.world import Spot, whole_and_segments
from softarm.estimator.small_matrices import factorise, solve_factored

CLOSE = 1e-10
"""Change of a strain, as a bend [rad], at which a step of the friction has been solved."""
SLIP_STEPS = 50
"""Steps towards it at most."""
NEWTON_STEPS = 10
"""How many of them are Newton's where fibres slip; the rest, should those not end, are shorter."""


def hysteresis(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Let friction inside the material carry a part of the load, by the same amount at every rate.

    With the strain eps beside what would be the strain u without friction, u = eps + a z. By Bouc and Wen
    with n = 1, dz = d eps - |d eps| z / r, z runs towards r along the way of the strain; if friction is
    abrupt it follows the strain until |z| = r and stays there (Prandtl's elastic-slip element). What slips is
    either the bend as a whole, with both its components, or every fibre of a thin ring for itself, whose
    friction resists elongation and bend together; strains of fibres are as bends then.
    """
    strength, reach, fibres, abrupt = theta
    strengths, stops = strength * spot.segments, bool(abrupt)
    strains = signals.strains.copy()
    if not fibres:
        loads = np.ascontiguousarray(strains[..., :2])
        bends, friction = memory or (loads[0], np.zeros_like(loads[0]))
        bends, friction = bends.copy(), friction.copy()
        strains[..., :2] = slipping(loads, strengths, reach, stops, bends, friction)
        return strains, (bends, friction)
    radii = spot.world.radii
    loads = of_rings(strains, radii)
    ring, friction = memory or (loads[0], np.zeros((len(radii), len(YIELDING))))
    ring, friction = ring.copy(), friction.copy()
    slipped = slipping_fibres(loads, strengths, reach, stops, ring, friction)
    return with_rings(strains, slipped, radii), (ring, friction)


@njit(cache=True, nogil=True)
def slipping(
    loads: Floats, strengths: Floats, reach: float, stops: bool, bends: Floats, friction: Floats
) -> Floats:
    """Step bends that slip.

    Along a straight change of length d in the direction n, z' = r n + (z - r n) exp(-d / r) is exact. So the
    change is (u - eps - a z exp(-d / r)) / (1 + a r (1 - exp(-d / r)) / d), and d a fixed point. Where
    friction stops, z' is z + d or, beyond the reach, of length r along z + u - eps, which it lags behind.

    Args:
        loads: The bends u without friction, shape (samples, segments, 2).
        strengths: a of each segment, shape (segments,).
        reach: r.
        stops: Whether friction is abrupt.
        bends: Bends before the first sample, shape (segments, 2); overwritten.
        friction: z before the first sample, shape (segments, 2); overwritten.

    Returns:
        The bends, shape (samples, segments, 2).
    """
    out = np.empty_like(loads)
    for sample in range(len(loads)):
        for k in range(len(strengths)):
            toward_x, toward_y = loads[sample, k, 0] - bends[k, 0], loads[sample, k, 1] - bends[k, 1]
            if stops:
                x = (toward_x - strengths[k] * friction[k, 0]) / (1.0 + strengths[k])
                y = (toward_y - strengths[k] * friction[k, 1]) / (1.0 + strengths[k])
                held_x, held_y = friction[k, 0] + x, friction[k, 1] + y
                if np.hypot(held_x, held_y) > reach:
                    pulled_x, pulled_y = friction[k, 0] + toward_x, friction[k, 1] + toward_y
                    share = reach / np.hypot(pulled_x, pulled_y)
                    held_x, held_y = share * pulled_x, share * pulled_y
                    x, y = toward_x - strengths[k] * held_x, toward_y - strengths[k] * held_y
                friction[k, 0], friction[k, 1] = held_x, held_y
            else:
                way, before = 0.0, -1.0
                kept, slope = 1.0, 1.0
                for _ in range(SLIP_STEPS):
                    if abs(way - before) < CLOSE:
                        break
                    stiff = 1.0 + strengths[k] * slope
                    x = (toward_x - strengths[k] * friction[k, 0] * kept) / stiff
                    y = (toward_y - strengths[k] * friction[k, 1] * kept) / stiff
                    before, way = way, np.hypot(x, y)
                    kept = np.exp(-way / reach)
                    slope = reach * (1.0 - kept) / way if way > 0.0 else 1.0
                friction[k, 0] = friction[k, 0] * kept + slope * x
                friction[k, 1] = friction[k, 1] * kept + slope * y
            bends[k, 0] += x
            bends[k, 1] += y
            out[sample, k] = bends[k]
    return out


@njit(cache=True, nogil=True)
def slipping_fibres(
    loads: Floats, strengths: Floats, reach: float, stops: bool, strains: Floats, friction: Floats
) -> Floats:
    """Step rings of fibres that slip.

    The ring resists (d / r, a, b) with diag(1, 1/2, 1/2), and friction with the mean over the fibres of what
    holds each, times its row of (1, cos p, sin p). A fibre's friction never falls as the fibre stretches, so
    that the balance is the minimum of a convex function.

    Args:
        loads: Elongation over the radius and both bends without friction, shape (samples, segments, 3).
        strengths: a of each segment, shape (segments,).
        reach: r.
        stops: Whether friction is abrupt.
        strains: Before the first sample, shape (segments, 3); overwritten.
        friction: z of each fibre before the first sample, shape (segments, fibres); overwritten.

    Returns:
        The strains, of the shape of the loads.
    """
    out = loads.copy()
    stiffness, lower = np.empty((3, 3)), np.empty((3, 3))
    step, strain, held = np.empty(3), np.empty(3), np.empty(len(YIELDING))
    for k in range(len(strengths)):
        a = strengths[k]
        if a == 0.0:
            continue
        for sample in range(len(loads)):
            strain[:] = strains[k]
            if sample > 0:  # the ring gives way about as it would without friction
                strain += loads[sample, k] - loads[sample - 1, k]
            for iteration in range(SLIP_STEPS):
                stiffness[:] = RING
                for i in range(3):
                    step[i] = RING[i, i] * (loads[sample, k, i] - strain[i])
                _hold(a, reach, stops, strain - strains[k], friction[k], held, step, stiffness)
                if iteration < NEWTON_STEPS and factorise(stiffness, lower):
                    solve_factored(lower, step)
                else:
                    for i in range(3):
                        step[i] /= RING[i, i] * (1.0 + max(a, 0.0))
                strain += step
                if np.abs(step).max() < CLOSE:
                    break
            strains[k] = strain
            friction[k] = held
            out[sample, k] = strain
    return out


@njit(cache=True, nogil=True)
def _hold(  # type: ignore[no-untyped-def]
    strength, reach, stops, change, friction, held, force, stiffness
):
    """Find what holds each fibre after a change of the ring; take it from a force, and add its stiffness."""
    fibres = len(YIELDING)
    for f in range(fibres):
        stretch = 0.0
        for i in range(3):
            stretch += YIELDING[f, i] * change[i]
        if stops:
            held[f] = min(max(friction[f] + stretch, -reach), reach)
            rise = 1.0 if held[f] == friction[f] + stretch else 0.0
        else:
            limit = reach if stretch > 0.0 else -reach
            kept = np.exp(-abs(stretch) / reach)
            held[f] = limit + (friction[f] - limit) * kept
            rise = (1.0 - friction[f] / limit) * kept
        for i in range(3):
            share = strength * YIELDING[f, i] / fibres
            force[i] -= share * held[f]
            for j in range(3):
                stiffness[i, j] += share * rise * YIELDING[f, j]


HYSTERESIS = Effect(
    name="hysteresis",
    hook="constitutive",
    parameters=(
        ParameterSpec("strength", "1", 0.15, -0.5, 0.9, spread=0.2, dissipates=True),
        ParameterSpec("reach", "rad", 0.1, 0.002, 2.0, "shape", "log", spread=1.0),
        ParameterSpec("fibres", "1", 1.0, 0.0, 1.0, "shape", choices=(0.0, 1.0)),
        ParameterSpec("abrupt", "1", 0.0, 0.0, 1.0, "shape", choices=(0.0, 1.0)),
    ),
    places=whole_and_segments,
    act=hysteresis,
    statement="The material of {where} has hysteresis: after each reversal friction {fibres:=in its bend|in "
    "every fibre of its wall} adds {strength:percent} to its stiffness until the bend has changed by about "
    "{reach}, at any rate, and then yields {abrupt:=little by little|at once}.",
    source="Y. K. Wen, J. Eng. Mech. 102 (1976) 249; M. Ismail et al., Arch. Comput. Meth. Eng. 16 (2009); "
    "L. Prandtl, Z. Angew. Math. Mech. 8 (1928) 85",
    equivalence=("memory_at_one_rate",),
    needs=frozenset({"two_rates", "two_amplitudes"}),
    splits=(
        ("viscoelastic_creep", "ramps at two rates, then holds of three time constants"),
        ("line_lag", "ramps of 10 and 100 s against measured pressures"),
    ),
    when="direction of change",
    shapes=tuple(
        (reach, fibres, abrupt)
        for fibres in (0.0, 1.0)
        for abrupt in (0.0, 1.0)
        for reach in (0.03, 0.1, 0.3)
    ),
)

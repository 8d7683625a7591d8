"""A straight, uniform, linearly elastic rod with pressures that bend it: laws that are known exactly."""

import numpy as np

from softarm.estimator.model import Load
from softarm.estimator.rod.arrays import Laws
from softarm.estimator.rod.chain import Chain, point_weights
from softarm.estimator.rod.laws import term_table
from softarm.estimator.rod.model import CalibratedRod

LENGTH, BENDING, TORSION, STRETCH, SHEAR = 0.27, 0.03, 0.02, 60.0, 40.0
LINEAR_DENSITY = 0.8  # kg/m


def linear_rod(
    links: int = 8, curl: float = 0.0, quadratic: float = 0.0, scaled: bool = False
) -> CalibratedRod:
    """Return a rod of two segments with three pressures each.

    Args:
        links: Number of links, even.
        curl: Bend of each link per 30 kPa [rad].
        quadratic: Size of random quadratic terms, for checks of derivatives.
        scaled: Whether some of them change with the stiffness factor.
    """
    heights = np.linspace(0.0, LENGTH, links + 1)
    step = LENGTH / links
    half = links // 2
    table = term_table(6, 3, scaled=scaled)
    coefficients = np.random.default_rng(4).normal(size=(links, len(table), 8)) * quadratic
    linear = [int(np.flatnonzero((table == [0, 0, 0, v]).all(axis=1))[0]) for v in range(1, 10)]
    coefficients[:, linear] = 0.0
    laws = step / np.array([BENDING, BENDING, TORSION])
    for axis in range(3):
        coefficients[:, linear[3 + axis], axis] = laws[axis]
    # Shear; its bend moves the far end by -F l^3 / 24 E I about the middle frame.
    across = step / SHEAR + step**3 / BENDING * (1 / 12)
    coefficients[:, linear[0], 3] = coefficients[:, linear[1], 4] = across
    coefficients[:, linear[2], 5] = step / STRETCH
    for k, azimuth in enumerate(np.radians([0.0, 120.0, 240.0])):
        coefficients[:, linear[6 + k], 0] = -curl * np.sin(azimuth)
        coefficients[:, linear[6 + k], 1] = curl * np.cos(azimuth)
    chambers = np.array([[0, 1, 2]] * half + [[3, 4, 5]] * half, dtype=np.int64)
    spread = np.linspace(0.0, 1.0, 401)
    weights = point_weights(spread, np.full(401, step)).mean(axis=0)
    chain = Chain(
        heights=heights,
        sections=("intermediate", "tip"),
        section_station=np.array([half, links]),
        section_offset=np.array([[0.0, 0.0, 0.0], [0.002, -0.001, 0.005]]),
        section_rotation=np.array([np.eye(3), np.diag([-1.0, -1.0, 1.0])]),
        regions=("upper",) * half + ("lower",) * half,
        chambers=chambers,
        chamber_count=6,
        mass=np.full(links, LINEAR_DENSITY * step),
        mass_centre=np.full(links, 0.5),
        mass_weights=np.tile(weights, (links, 1)),
    )
    scale = np.tile([2.0, 2.0, 2.0, 0.2, 0.2, 0.2, 3e4, 3e4, 3e4], (links, 1))
    for v in range(6):
        coefficients[:, linear[v]] *= scale[:, v, None]
    laws_ = Laws(table, coefficients, chambers, scale, np.full(scale.shape, np.inf), np.ones(links))
    loads = tuple(
        Load(f"{section}_{name}", "force", axis, section=section)
        for section in ("intermediate", "tip")
        for name, axis in (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 1.0, 0.0)))
    )
    return CalibratedRod(chain, laws_, loads)

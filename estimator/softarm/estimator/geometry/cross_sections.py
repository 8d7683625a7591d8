"""The cross-sections of the parametric bodies, as patches."""

from collections.abc import Callable

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.geometry.patches import Curve, Patch, arc, line, moved, straight
from softarm.estimator.geometry.resolution import Resolution
from softarm.estimator.specimen import Block, Cylinder, QuadrantCylinder, SweptLobes

ORIGIN = np.zeros(2)
# Where between centre and vertex the core's inner corners lie.
CORE_SHARE = 0.5


def lobe_patches(shape: SweptLobes, height: float, azimuth: float, resolution: Resolution) -> list[Patch]:
    """Build the patches of the lobed cross-section at a height.

    Nine quadrilaterals make the triangular core: one at each vertex, and six around the centre. Every side of
    the triangle, and so every chamber's floor, has four, as has every lobe's arc: with two on the floor a
    model bends 5 % too little under pressure.

    Args:
        shape: Shape of the body.
        height: Distance from the base [m].
        azimuth: Direction of lobe 0 [rad].
        resolution: Divisions of each of these quadrilaterals.
    """
    radius = float(np.interp(height, shape.station_heights_m, shape.lobe_radii_m))
    patches = []
    for lobe in range(3):
        # A lobe is drawn opening to +y.
        angle = azimuth + lobe * 2.0 * np.pi / 3.0 - 0.5 * np.pi
        patches += [moved(part, angle, ORIGIN) for part in _core(radius, resolution.arc_divisions)]
        shift = radius / np.sqrt(3.0) * np.array([-np.sin(angle), np.cos(angle)])
        half = _half_lobe(radius, shape.wall_m, shape.floor_m, resolution, lobe)
        other = [_mirrored(part, lambda points: points * [-1.0, 1.0]) for part in half]
        patches += [moved(part, angle, shift) for part in half + other]
    return patches


def _core(radius: float, around: int) -> list[Patch]:
    """Build the third of the triangle about its right vertex; the lobe's side is above the centre."""
    side = radius / np.sqrt(3.0)
    vertex = np.array([radius, side])
    top = np.array([0.0, side])
    right = side * np.array([np.cos(-np.pi / 6.0), np.sin(-np.pi / 6.0)])
    inner = CORE_SHARE * vertex
    upper, below = 0.5 * (vertex + top), 0.5 * (vertex + right)
    divisions = (around, around)
    return [
        straight([vertex, upper, inner, below], divisions),
        straight([upper, top, ORIGIN, inner], divisions),
        straight([below, inner, ORIGIN, right], divisions),
    ]


def _half_lobe(radius: float, wall: float, floor: float, resolution: Resolution, lobe: int) -> list[Patch]:
    """Build the right half of a half disc on the x axis that opens to +y."""
    around, through = resolution.arc_divisions, resolution.wall_divisions
    inner, top = radius - wall, 0.5 * np.pi
    edge = np.arcsin(floor / inner)
    middle = 0.5 * (edge + top)
    corner = inner * np.array([np.cos(edge), np.sin(edge)])
    bend = inner * np.array([np.cos(middle), np.sin(middle)])
    rim, rim_half = np.array([radius, 0.0]), np.array([0.5 * radius, 0.0])
    foot, apex = np.array([0.0, floor]), np.array([0.0, inner])
    foot_half, waist = 0.5 * (foot + corner), 0.5 * (foot + apex)
    hub = 0.5 * (foot_half + 0.5 * (waist + bend))
    walls = [
        straight([ORIGIN, rim_half, foot_half, foot], (around, through)),
        straight([rim_half, rim, corner, foot_half], (around, through)),
        _ring(inner, (edge, middle), radius, (0.0, middle), (around, through)),
        _ring(inner, (middle, top), radius, (middle, top), (around, through)),
    ]
    chamber = [
        straight([foot, foot_half, hub, waist], (around, around)),
        straight([foot_half, corner, bend, hub], (around, around))._replace(
            east=arc(ORIGIN, inner, edge, middle)
        ),
        straight([hub, bend, apex, waist], (around, around))._replace(east=arc(ORIGIN, inner, middle, top)),
    ]
    return walls + [part._replace(cavity=lobe) for part in chamber]


def _ring(
    inner: float,
    inside: tuple[float, float],
    outer: float,
    outside: tuple[float, float],
    divisions: tuple[int, int],
) -> Patch:
    """Build a piece of wall between two concentric arcs, each from one angle to another [rad].

    s runs along the arcs, t inwards, so that the patch is counter-clockwise.
    """
    near, far = arc(ORIGIN, inner, *inside), arc(ORIGIN, outer, *outside)
    ends = np.array([0.0, 1.0])
    (near_start, near_end), (far_start, far_end) = near(ends), far(ends)
    return Patch(far, line(far_end, near_end), near, line(far_start, near_start), divisions)


def _mirrored(patch: Patch, reflect: Callable[[Floats], Floats]) -> Patch:
    """Reflect a patch, and keep it counter-clockwise."""

    def backwards(curve: Curve) -> Curve:
        return lambda s: reflect(curve(1.0 - s))

    def forwards(curve: Curve) -> Curve:
        return lambda s: reflect(curve(s))

    return Patch(
        backwards(patch.south),
        forwards(patch.west),
        backwards(patch.north),
        forwards(patch.east),
        patch.divisions,
        patch.cavity,
    )


def quadrant_patches(shape: QuadrantCylinder, azimuth: float, resolution: Resolution) -> list[Patch]:
    """Build the patches of the cylinder with four chambers; the same at every height.

    Args:
        shape: Shape of the body.
        azimuth: Direction of chamber 0's centre [rad]; the dividing walls lie 45 degrees beside it.
        resolution: Divisions.
    """
    half = 0.5 * shape.wall_m
    root = np.array([shape.core_m - half, half])
    diagonal = np.array([0.5, 0.5]) * shape.core_m
    sector = _half_sector(shape, 0.25 * np.pi, line(root, diagonal), resolution)
    return _around(sector, 4, azimuth)


def cylinder_patches(shape: Cylinder, azimuth: float, count: int, resolution: Resolution) -> list[Patch]:
    """Build the patches of a cylinder with equal chambers around a round core; the same at every height.

    Args:
        shape: Shape of the body.
        azimuth: Direction of chamber 0's centre [rad].
        count: Number of chambers.
        resolution: Divisions.
    """
    edge = float(np.arcsin(0.5 * shape.wall_m / shape.core_radius_m))
    core = arc(ORIGIN, shape.core_radius_m, edge, np.pi / count)
    return _around(_half_sector(shape, np.pi / count, core, resolution), count, azimuth)


def _around(half_sector: list[Patch], count: int, azimuth: float) -> list[Patch]:
    """Mirror half a sector and repeat it around the axis; chamber 0 is centred at ``azimuth`` [rad]."""
    patches = []
    for number in range(count):
        # Half a sector begins at a dividing wall, half a pitch before the chamber's centre.
        angle = azimuth + (2.0 * number - 1.0) * np.pi / count
        for patch in half_sector:
            placed = patch._replace(cavity=number) if patch.cavity >= 0 else patch
            patches.append(moved(placed, angle, ORIGIN))
            mirrored = _mirrored(placed, lambda points: points * [1.0, -1.0])
            patches.append(moved(mirrored, angle + 2.0 * np.pi / count, ORIGIN))
    return patches


def _half_sector(
    shape: QuadrantCylinder | Cylinder, middle: float, core: Curve, resolution: Resolution
) -> list[Patch]:
    """Build the half of a sector between the x axis, along which half a dividing wall lies, and its middle.

    Args:
        shape: Radius and walls.
        middle: Direction of the middle of the chamber [rad].
        core: Inner boundary of the chamber, from the dividing wall to the middle.
        resolution: Divisions.
    """
    half, outer = 0.5 * shape.wall_m, shape.outer_radius_m
    inner = outer - shape.wall_m
    around, through = resolution.arc_divisions, resolution.wall_divisions
    edge, rim = np.arcsin(half / inner), np.arcsin(half / outer)
    root, diagonal = core(np.array([0.0, 1.0]))
    tip = inner * np.array([np.cos(edge), np.sin(edge)])
    axis_root, axis_tip = np.array([root[0], 0.0]), np.array([tip[0], 0.0])
    far = inner * np.array([np.cos(middle), np.sin(middle)])
    outside = arc(ORIGIN, outer, 0.0, rim)
    return [
        Patch(
            line(ORIGIN, axis_root),
            line(axis_root, root),
            lambda s: core(1.0 - s),
            line(ORIGIN, diagonal),
            (around, through),
        ),
        straight([axis_root, axis_tip, tip, root], (around, through)),
        Patch(
            line(axis_tip, np.array([outer, 0.0])),
            outside,
            line(tip, outside(np.ones(1))[0]),
            line(axis_tip, tip),
            (through, through),
        ),
        _ring(inner, (edge, middle), outer, (rim, middle), (around, through)),
        Patch(
            line(root, tip), arc(ORIGIN, inner, edge, middle), line(diagonal, far), core, (around, around), 0
        ),
    ]


def block_patches(shape: Block, resolution: Resolution) -> list[Patch]:
    """Build the one patch of a cuboid's cross-section, ``2 around`` elements to each side."""
    x, y = 0.5 * shape.width_x_m, 0.5 * shape.width_y_m
    corners = [np.array(corner) for corner in ((-x, -y), (x, -y), (x, y), (-x, y))]
    return [straight(corners, (2 * resolution.arc_divisions, 2 * resolution.arc_divisions))]

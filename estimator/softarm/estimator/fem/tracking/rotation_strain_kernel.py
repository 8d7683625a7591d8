"""Kernels that carry displacements between configurations; ``fem.rotation_strain`` has the plain path.

Eight elements go through together, one per lane, in single precision; its error in a step appears in the
next residual. Nodal values enter less those of the element's first node, so that a small
strain does not drown in the motion of the whole. Matrices stand at addresses, nine rows of lanes each. The
address of a local array is taken inside the loop that uses it: Numba frees an array after the last mention of
its name, and an address is none.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.linalg.simd import (
    SimdType,
    binary_of,
    broadcast_of,
    constant_of,
    fma_of,
    load_of,
    store_of,
)
from softarm.estimator.mesh import Singles

SINGLE_SIMD_WIDTH = 8
"""Numbers in a vector."""

singles = SimdType("SimdSingles", ir.FloatType(), SINGLE_SIMD_WIDTH)

load_singles = cast("Callable[[int], Any]", load_of(singles))
"""Read eight numbers at an address."""
store_singles = cast("Callable[[int, Any], None]", store_of(singles))
"""Write eight numbers at an address."""
fma_singles = cast("Callable[[Any, Any, Any], Any]", fma_of(singles))
"""Return first * second + added, rounded once where the processor can."""
multiply_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fmul"))
"""Return first * second."""
add_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fadd"))
"""Return first + second."""
subtract_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fsub"))
"""Return first - second."""
divide_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fdiv"))
"""Return first / second."""
zero_singles = cast("Callable[[], Any]", constant_of(singles, 0.0))
"""Return eight zeros."""
broadcast_single = cast("Callable[[Any], Any]", broadcast_of(singles))
"""Return a number in every lane; it must be of single precision."""


# Bytes from one vector to the next, and of a matrix.
STEP = 4 * SINGLE_SIMD_WIDTH
MATRIX = 9 * STEP
SWEEPS = 4
"""Sweeps of Newton's iteration: enough for single precision where strains are below a half."""


@compiled
def _number(value: float) -> Any:
    return broadcast_single(np.float32(value))


@compiled
def _dot(a: int, b: int, far: int, near: int) -> Any:
    """Return the sum over three vectors ``far`` apart at a with those ``near`` apart at b."""
    rest = fma_singles(
        load_singles(a + far),
        load_singles(b + near),
        multiply_singles(load_singles(a + 2 * far), load_singles(b + 2 * near)),
    )
    return fma_singles(load_singles(a), load_singles(b), rest)


@compiled
def _product(a: int, b: int, out: int) -> None:
    """Fill A B."""
    for i in range(3):
        for k in range(3):
            store_singles(out + (3 * i + k) * STEP, _dot(a + 3 * i * STEP, b + k * STEP, STEP, 3 * STEP))


@compiled
def _transposed_product(a: int, b: int, out: int) -> None:
    """Fill A^T B."""
    for i in range(3):
        for k in range(3):
            store_singles(out + (3 * i + k) * STEP, _dot(a + i * STEP, b + k * STEP, 3 * STEP, 3 * STEP))


@compiled
def _times_cofactors(a: int, cofactors: int, reciprocal: int, out: int) -> None:
    """Fill A C^T times the factor at ``reciprocal``."""
    factor = load_singles(reciprocal)
    for i in range(3):
        for k in range(3):
            row = _dot(a + 3 * i * STEP, cofactors + 3 * k * STEP, STEP, STEP)
            store_singles(out + (3 * i + k) * STEP, multiply_singles(factor, row))


@compiled
def _cofactors(m: int, out: int, reciprocal: int) -> None:
    """Fill det(M) M^-T, and 1 / det(M) at ``reciprocal``."""
    for i in range(3):
        a, b = m + 3 * ((i + 1) % 3) * STEP, m + 3 * ((i + 2) % 3) * STEP
        for k in range(3):
            c, d = ((k + 1) % 3) * STEP, ((k + 2) % 3) * STEP
            second = multiply_singles(load_singles(a + d), load_singles(b + c))
            first = multiply_singles(load_singles(a + c), load_singles(b + d))
            store_singles(out + (3 * i + k) * STEP, subtract_singles(first, second))
    store_singles(reciprocal, divide_singles(_number(1.0), _dot(m, out, STEP, STEP)))


@compiled
def _collect_corners(nodal: Floats, nodes: Indices, corners: Singles) -> None:
    """Fill the nodal values of eight elements less those of their first nodes, shape (nodes, 3, lanes)."""
    for lane in range(SINGLE_SIMD_WIDTH):
        first = nodes[lane, 0] if nodes[lane, 0] >= 0 else -1 - nodes[lane, 0]
        for n in range(nodes.shape[1]):
            node = nodes[lane, n] if nodes[lane, n] >= 0 else -1 - nodes[lane, n]
            for i in range(3):
                corners[n, i, lane] = nodal[node, i] - nodal[first, i]


@compiled
def _add_to_nodes(forces: Singles, nodes: Indices, nodal: Floats) -> None:
    """Add the values of eight elements to the nodes, padding left out."""
    for lane in range(SINGLE_SIMD_WIDTH):
        for n in range(nodes.shape[1]):
            if nodes[lane, n] >= 0:
                for i in range(3):
                    nodal[nodes[lane, n], i] += forces[n, i, lane]


@compiled
def _gradient(corners: int, slopes: int, nodes: int, out: int) -> None:
    """Fill d v_i / d X_j at a point from the nodes' values and slopes, both of shape (nodes, 3, lanes)."""
    f00, f01, f02 = zero_singles(), zero_singles(), zero_singles()
    f10, f11, f12 = zero_singles(), zero_singles(), zero_singles()
    f20, f21, f22 = zero_singles(), zero_singles(), zero_singles()
    for n in range(nodes):
        v, g = corners + 3 * n * STEP, slopes + 3 * n * STEP
        x, y, z = load_singles(v), load_singles(v + STEP), load_singles(v + 2 * STEP)
        g0, g1, g2 = load_singles(g), load_singles(g + STEP), load_singles(g + 2 * STEP)
        f00, f01, f02 = fma_singles(x, g0, f00), fma_singles(x, g1, f01), fma_singles(x, g2, f02)
        f10, f11, f12 = fma_singles(y, g0, f10), fma_singles(y, g1, f11), fma_singles(y, g2, f12)
        f20, f21, f22 = fma_singles(z, g0, f20), fma_singles(z, g1, f21), fma_singles(z, g2, f22)
    store_singles(out, f00)
    store_singles(out + STEP, f01)
    store_singles(out + 2 * STEP, f02)
    store_singles(out + 3 * STEP, f10)
    store_singles(out + 4 * STEP, f11)
    store_singles(out + 5 * STEP, f12)
    store_singles(out + 6 * STEP, f20)
    store_singles(out + 7 * STEP, f21)
    store_singles(out + 8 * STEP, f22)


@compiled
def _add_divergence(field: int, weight: int, slopes: int, nodes: int, forces: int) -> None:
    """Add w A_ij G_nj to every node n, the adjoint of ``_gradient``."""
    w = load_singles(weight)
    a00, a01 = multiply_singles(w, load_singles(field)), multiply_singles(w, load_singles(field + STEP))
    a02 = multiply_singles(w, load_singles(field + 2 * STEP))
    a10 = multiply_singles(w, load_singles(field + 3 * STEP))
    a11 = multiply_singles(w, load_singles(field + 4 * STEP))
    a12 = multiply_singles(w, load_singles(field + 5 * STEP))
    a20 = multiply_singles(w, load_singles(field + 6 * STEP))
    a21 = multiply_singles(w, load_singles(field + 7 * STEP))
    a22 = multiply_singles(w, load_singles(field + 8 * STEP))
    for n in range(nodes):
        g, f = slopes + 3 * n * STEP, forces + 3 * n * STEP
        g0, g1, g2 = load_singles(g), load_singles(g + STEP), load_singles(g + 2 * STEP)
        x = fma_singles(a00, g0, fma_singles(a01, g1, fma_singles(a02, g2, load_singles(f))))
        y = fma_singles(a10, g0, fma_singles(a11, g1, fma_singles(a12, g2, load_singles(f + STEP))))
        z = fma_singles(a20, g0, fma_singles(a21, g1, fma_singles(a22, g2, load_singles(f + 2 * STEP))))
        store_singles(f, x)
        store_singles(f + STEP, y)
        store_singles(f + 2 * STEP, z)


@compiled
def _rotation(h: int, out: int) -> None:
    """Fill R - 1 for the rotation R by the skew part of H.

    By Cayley's map, which is a rotation for any argument, of tan(angle / 2) by its series.
    """
    x = subtract_singles(load_singles(h + 7 * STEP), load_singles(h + 5 * STEP))
    y = subtract_singles(load_singles(h + 2 * STEP), load_singles(h + 6 * STEP))
    z = subtract_singles(load_singles(h + 3 * STEP), load_singles(h + STEP))
    # The skew part of H has the spin w = (x, y, z) / 2; q = tan(|w| / 2) w / |w| = w / 2 (1 + ...).
    square = multiply_singles(_number(0.25), fma_singles(x, x, fma_singles(y, y, multiply_singles(z, z))))
    series = fma_singles(square, _number(1.0 / 120.0), _number(1.0 / 12.0))
    half = multiply_singles(_number(0.25), fma_singles(square, series, _number(1.0)))
    x, y, z = multiply_singles(half, x), multiply_singles(half, y), multiply_singles(half, z)
    xx, yy, zz = multiply_singles(x, x), multiply_singles(y, y), multiply_singles(z, z)
    whole = add_singles(_number(1.0), add_singles(xx, add_singles(yy, zz)))
    twice = divide_singles(_number(2.0), whole)
    less = multiply_singles(_number(-1.0), twice)
    store_singles(out, multiply_singles(less, add_singles(yy, zz)))
    store_singles(out + 4 * STEP, multiply_singles(less, add_singles(xx, zz)))
    store_singles(out + 8 * STEP, multiply_singles(less, add_singles(xx, yy)))
    xy, xz, yz = multiply_singles(x, y), multiply_singles(x, z), multiply_singles(y, z)
    store_singles(out + STEP, multiply_singles(twice, subtract_singles(xy, z)))
    store_singles(out + 3 * STEP, multiply_singles(twice, add_singles(xy, z)))
    store_singles(out + 2 * STEP, multiply_singles(twice, add_singles(xz, y)))
    store_singles(out + 6 * STEP, multiply_singles(twice, subtract_singles(xz, y)))
    store_singles(out + 5 * STEP, multiply_singles(twice, subtract_singles(yz, x)))
    store_singles(out + 7 * STEP, multiply_singles(twice, add_singles(yz, x)))


@compiled
def _rotate_finitely(f: int, change: int, work: int) -> None:
    """Replace a change H of the deformation F by exp(spin) (1 + strain) F - F, spin + strain = H F^-1.

    Sums of small matrices alone, so that no digits cancel. ``work`` is five matrices.
    """
    cofactors, h, rotation, strain = work, work + MATRIX, work + 2 * MATRIX, work + 3 * MATRIX
    reciprocal = work + 4 * MATRIX
    _cofactors(f, cofactors, reciprocal)
    _times_cofactors(change, cofactors, reciprocal, h)
    _rotation(h, rotation)
    for i in range(3):
        for k in range(3):
            both = add_singles(load_singles(h + (3 * i + k) * STEP), load_singles(h + (3 * k + i) * STEP))
            store_singles(strain + (3 * i + k) * STEP, multiply_singles(_number(0.5), both))
    _product(rotation, strain, h)
    for m in range(9):
        at = m * STEP
        straight = add_singles(load_singles(rotation + at), load_singles(strain + at))
        store_singles(h + at, add_singles(load_singles(h + at), straight))
    _product(h, f, change)


@compiled
def point_gradients(
    nodal: Floats, connectivity: Indices, gradients: Singles, diagonal: float, fields: Singles
) -> None:
    """Fill d v_i / d X_j plus a multiple of the identity, shape (groups, 9, lanes)."""
    points, nodes = gradients.shape[1], gradients.shape[2]
    corners = np.empty((nodes, 3, SINGLE_SIMD_WIDTH), dtype=np.float32)
    for e in range(connectivity.shape[0]):
        _collect_corners(nodal, connectivity[e], corners)
        for p in range(points):
            out = fields[e * points + p].ctypes.data
            _gradient(corners.ctypes.data, gradients[e, p].ctypes.data, nodes, out)
            for m in (0, 4, 8):
                at = out + m * STEP
                store_singles(at, add_singles(load_singles(at), _number(diagonal)))


@compiled
def corotated_divergence(
    source: Floats,
    connectivity: Indices,
    gradients: Singles,
    weights: Singles,
    rotations: Singles,
    back: bool,
    nodal: Floats,
) -> None:
    """Add the divergence of T A, or of T^T A when ``back``, with A the gradient of ``source``."""
    points, nodes = gradients.shape[1], gradients.shape[2]
    corners = np.empty((nodes, 3, SINGLE_SIMD_WIDTH), dtype=np.float32)
    forces = np.empty((nodes, 3, SINGLE_SIMD_WIDTH), dtype=np.float32)
    work = np.empty((2, 9, SINGLE_SIMD_WIDTH), dtype=np.float32)
    for e in range(connectivity.shape[0]):
        _collect_corners(source, connectivity[e], corners)
        forces[:] = 0.0
        for p in range(points):
            field, rotated = work[0].ctypes.data, work[1].ctypes.data
            slopes, rotation = gradients[e, p].ctypes.data, rotations[e * points + p].ctypes.data
            _gradient(corners.ctypes.data, slopes, nodes, field)
            if back:
                _transposed_product(rotation, field, rotated)
            else:
                _product(rotation, field, rotated)
            _add_divergence(rotated, weights[e, p].ctypes.data, slopes, nodes, forces.ctypes.data)
        _add_to_nodes(forces, connectivity[e], nodal)


@compiled
def finite_rotation_divergence(
    source: Floats,
    connectivity: Indices,
    gradients: Singles,
    weights: Singles,
    rotations: Singles,
    deformation: Singles,
    nodal: Floats,
) -> None:
    """Add the divergence of ``_rotate_finitely``'s change for H = T A, with A the gradient of ``source``."""
    points, nodes = gradients.shape[1], gradients.shape[2]
    corners = np.empty((nodes, 3, SINGLE_SIMD_WIDTH), dtype=np.float32)
    forces = np.empty((nodes, 3, SINGLE_SIMD_WIDTH), dtype=np.float32)
    work = np.empty((7, 9, SINGLE_SIMD_WIDTH), dtype=np.float32)
    for e in range(connectivity.shape[0]):
        _collect_corners(source, connectivity[e], corners)
        forces[:] = 0.0
        for p in range(points):
            field, rotated, rest = work[0].ctypes.data, work[1].ctypes.data, work[2].ctypes.data
            slopes, at = gradients[e, p].ctypes.data, e * points + p
            _gradient(corners.ctypes.data, slopes, nodes, field)
            _product(rotations[at].ctypes.data, field, rotated)
            _rotate_finitely(deformation[at].ctypes.data, rotated, rest)
            _add_divergence(rotated, weights[e, p].ctypes.data, slopes, nodes, forces.ctypes.data)
        _add_to_nodes(forces, connectivity[e], nodal)


@compiled
def rotations_between(before: Singles, after: Singles, rotations: Singles) -> None:
    """Fill the rotation of F_after F_before^-1 at every point, by Newton's iteration (Higham 1986)."""
    work = np.empty((2, 9, SINGLE_SIMD_WIDTH), dtype=np.float32)
    for p in range(after.shape[0]):
        cofactors, reciprocal = work[0].ctypes.data, work[1].ctypes.data
        matrix = rotations[p].ctypes.data
        _cofactors(before[p].ctypes.data, cofactors, reciprocal)
        _times_cofactors(after[p].ctypes.data, cofactors, reciprocal, matrix)
        for _ in range(SWEEPS):
            _cofactors(matrix, cofactors, reciprocal)
            factor = load_singles(reciprocal)
            for m in range(9):
                at = matrix + m * STEP
                other = fma_singles(factor, load_singles(cofactors + m * STEP), load_singles(at))
                store_singles(at, multiply_singles(_number(0.5), other))

"""Link laws: polynomials that give a link's strain from its wrench and the pressures around it.

With x = (wrench / (scale E), pressures / (scale E), 1 / E - 1), E the link's stiffness factor, the six
strains are y = sum_k c_k x_a x_b x_c x_d over a table of variables per term, variable 0 standing for the
constant 1. The last variable stands for the stiffness that does not scale with E: winding and rigid sections.

Far beyond the wrenches and pressures that it was fitted to, a polynomial bends back, and the arm with it. So
a law y goes on in proportion there, as r y(x / r), with the least r >= 1 that brings x / r within
``FARTHEST`` times the fit.
"""

from itertools import combinations_with_replacement

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.rod.arrays import Laws

DEGREE = 4
"""Factors per term in the table; lower degrees are filled up with the constant."""
FARTHEST = 3.0
"""Wrench or pressure, over the largest of the fit, up to which a law is the polynomial.

Of 1, 1.25, 1.5, 2, 3 and infinity, the one that was nearest to the finite elements on four arms, of which
two sag by 60 degrees when they are mounted sideways.
"""
OUTPUTS = 8
"""Six strains, padded to a full vector register."""


def term_table(
    wrench: int,
    pressures: int,
    total: int = 3,
    pressure_total: int = 4,
    mixed: tuple[tuple[int, int], ...] = ((1, 3),),
    scaled: bool = False,
) -> Indices:
    """List the monomials of a link law.

    Args:
        wrench: Number of wrench components.
        pressures: Number of pressures.
        total: Largest total degree of a general monomial.
        pressure_total: Largest degree of a monomial of pressures alone.
        mixed: Degrees in the wrench and in the pressures of more families of monomials.
        scaled: Whether monomials up to the second degree change with the stiffness factor.

    Returns:
        Variables of each term, the constant 0, wrench 1 to 6, then pressures and the variable of the
        stiffness factor; shape (terms, 4).
    """
    forces, pushes = range(1, wrench + 1), range(wrench + 1, wrench + pressures + 1)
    terms = {c for k in range(1, total + 1) for c in combinations_with_replacement([*forces, *pushes], k)}
    terms |= {c for k in range(1, pressure_total + 1) for c in combinations_with_replacement(pushes, k)}
    for by_wrench, by_pressure in mixed:
        terms |= {
            (*first, *second)
            for first in combinations_with_replacement(forces, by_wrench)
            for second in combinations_with_replacement(pushes, by_pressure)
        }
    if scaled:
        factor, every = wrench + pressures + 1, [*forces, *pushes]
        terms |= {(*c, factor) for k in (1, 2) for c in combinations_with_replacement(every, k)}
        terms |= {(c, factor, factor) for c in every}
    # Filled up in front: the last factor of a term is never the constant, on which `law_slopes` relies.
    rows = [(*(0,) * (DEGREE - len(term)), *term) for term in terms]
    # Sorted, since a set has no order and a rod should be fitted alike every time.
    return np.array(sorted(rows, key=lambda row: (sum(v > 0 for v in row), row)), dtype=np.int64)


def features(table: Indices, variables: Floats) -> Floats:
    """Evaluate all terms, shape (samples, terms), at variables, shape (samples, variables)."""
    padded = np.concatenate([np.ones((len(variables), 1)), variables], axis=1)
    values: Floats = np.prod(padded[:, table], axis=-1)
    return values


def feature_slopes(table: Indices, variables: Floats, directions: Floats) -> Floats:
    """Differentiate all terms along directions, both of shape (samples, variables)."""
    padded = np.concatenate([np.ones((len(variables), 1)), variables], axis=1)
    along = np.concatenate([np.zeros((len(variables), 1)), directions], axis=1)
    factors, slopes = padded[:, table], along[:, table]
    total = np.zeros(factors.shape[:2])
    for place in range(DEGREE):
        others = np.prod(np.delete(factors, place, axis=-1), axis=-1)
        total += others * slopes[..., place]
    return total


@njit(cache=True, nogil=True)
def law_slopes(
    table: Indices, coefficients: Floats, variables: Floats, value: Floats, slopes: Floats
) -> None:
    """Evaluate a law and its derivative: slopes (1 + variables, 8), of which row 0 is zero.

    Neighbours in the table share all factors but the last: what they add to the derivatives by these is
    gathered in registers before any memory is written to.
    """
    value.fill(0.0)
    slopes.fill(0.0)
    x, k, terms = variables, 0, table.shape[0]
    while k < terms:
        a, b, c = table[k, 0], table[k, 1], table[k, 2]
        first = x[a] * x[b]
        shared = first * x[c]
        s0 = s1 = s2 = s3 = s4 = s5 = 0.0
        while k < terms and table[k, 2] == c and table[k, 1] == b and table[k, 0] == a:
            d = table[k, 3]
            r0, r1, r2 = coefficients[k, 0], coefficients[k, 1], coefficients[k, 2]
            r3, r4, r5 = coefficients[k, 3], coefficients[k, 4], coefficients[k, 5]
            _add((r0, r1, r2, r3, r4, r5), shared, slopes, d)
            s0 += r0 * x[d]
            s1 += r1 * x[d]
            s2 += r2 * x[d]
            s3 += r3 * x[d]
            s4 += r4 * x[d]
            s5 += r5 * x[d]
            k += 1
        gathered = s0, s1, s2, s3, s4, s5
        for o in range(6):
            value[o] += shared * gathered[o]
        if a > 0:
            _add(gathered, x[b] * x[c], slopes, a)
        if b > 0:
            _add(gathered, x[a] * x[c], slopes, b)
        if c > 0:
            _add(gathered, first, slopes, c)


@njit(cache=True, nogil=True)
def _add(strains: tuple[float, ...], factor: float, slopes: Floats, row: int) -> None:
    """Add six strains times a factor to a row; written out, since a loop would not keep them in registers."""
    slopes[row, 0] += factor * strains[0]
    slopes[row, 1] += factor * strains[1]
    slopes[row, 2] += factor * strains[2]
    slopes[row, 3] += factor * strains[3]
    slopes[row, 4] += factor * strains[4]
    slopes[row, 5] += factor * strains[5]


@njit(cache=True, nogil=True)
def evaluate_laws(laws: Laws, wrench: Floats, pressures: Floats, value: Floats, slopes: Floats) -> None:
    """Evaluate all links' laws.

    Args:
        laws: The laws.
        wrench: Shape (links, 6).
        pressures: [Pa], shape (chambers,).
        value: Filled with the strains, shape (links, 8).
        slopes: Filled with the derivative by the variables, shape (links, 8 + width, 8).
    """
    width = laws.chambers.shape[1]
    variables = np.empty(8 + width)
    variables[0] = 1.0
    for i in range(len(wrench)):
        for k in range(6):
            variables[1 + k] = wrench[i, k] / (laws.scale[i, k] * laws.stiffness[i])
        for n in range(width):
            k = laws.chambers[i, n]
            variables[7 + n] = 0.0 if k < 0 else pressures[k] / (laws.scale[i, 6 + n] * laws.stiffness[i])
        variables[7 + width] = 1.0 / laws.stiffness[i] - 1.0
        beyond, farthest = 1.0, 0
        for k in range(6 + width):
            reach, size = FARTHEST * laws.reach[i, k], abs(variables[1 + k]) * laws.scale[i, k]
            if reach > 0.0 and size > beyond * reach:
                beyond, farthest = size / reach, 1 + k
        if farthest > 0:
            variables[1 : 7 + width] /= beyond
        law_slopes(laws.table, laws.coefficients[i], variables, value[i], slopes[i])
        if farthest > 0:
            _go_on(beyond, farthest, variables, value[i], slopes[i])


@njit(cache=True, nogil=True)
def _go_on(beyond: float, farthest: int, variables: Floats, value: Floats, slopes: Floats) -> None:
    """Make value and slopes of a law at x / r those of r y(x / r).

    The derivative by x_k is that of y, and (y - y' x / r) dr/dx_k for the variable that is farthest beyond.

    Args:
        beyond: r.
        farthest: Variable that r divides down to its reach.
        variables: The constant 1, x / r, and the variable of the stiffness.
        value: y, shape (8,).
        slopes: y', shape (1 + variables, 8).
    """
    last = len(variables) - 1
    by_variable = 1.0 / variables[farthest]  # dr/dx = r / x
    for o in range(6):
        along = 0.0
        for k in range(1, last):
            along += slopes[k, o] * variables[k]
        slopes[farthest, o] += (value[o] - along) * by_variable
        slopes[last, o] *= beyond
        value[o] *= beyond

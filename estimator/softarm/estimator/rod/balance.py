"""Equilibrium of the chain, compiled: every link's strain follows from its wrench by its law."""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.linalg.blas import solve_rows
from softarm.estimator.rod.arrays import ChainInputs, CompiledChain, Laws, Work
from softarm.estimator.rod.laws import evaluate_laws
from softarm.estimator.rod.statics import action_points, place, wrenches
from softarm.estimator.rod.tangent import (
    inner_moments,
    link_motion,
    rotated_parts,
    unit_wrenches,
    wrench_jacobian,
)
from softarm.estimator.vectors import add_rotated

ITERATIONS = 25
"""Largest number of linearisations of a solve."""


@njit(cache=True, nogil=True)
def linearise_chain(chain: CompiledChain, drive: ChainInputs, work: Work, residual: Floats) -> None:
    """Evaluate law(wrench(strain)) + eigenstrain - strain and, in ``work.tangent``, its negative derivative.

    Args:
        chain: The chain.
        drive: Pressures, loads and eigenstrains.
        work: Strains and clamp are given, all else is filled.
        residual: Filled with law + eigenstrain - strain, shape (6 links,).
    """
    length, actions, laws = chain.length, chain.actions, chain.laws
    links = len(length)
    wrench, beyond = np.empty((links, 6)), np.empty((links, 15))
    value, inner, parts = np.empty((links, 8)), np.empty((links, 6, 3)), np.empty((links, 6, 3))
    by_strain, chord = np.empty((6 * links, 6 * links)), np.empty(3)
    strain, positions, middles = work.strain, work.positions, work.middles
    place(strain, length, work.rotations, positions, middles)
    action_points(strain, length, work.rotations, positions, actions, work.points)
    wrenches(positions, middles, actions, work.points, drive, wrench, beyond)
    evaluate_laws(laws, wrench, drive.pressures, value, work.slopes)
    for i in range(links):
        for k in range(3):
            chord[k] = positions[i + 1, k] - positions[i, k]
        link_motion(strain[i], work.rotations[i], middles[i], chord, positions[i + 1], work.motions[i])
        for k in range(6):
            residual[6 * i + k] = value[i, k] + drive.eigenstrain[i, k] - strain[i, k]
    inner_moments(strain, work.rotations, positions, actions, work.points, drive.force, inner)
    rotated_parts(middles, actions, drive, parts)
    wrench_jacobian(positions, middles, beyond, work.motions, inner, parts, by_strain)
    _through_laws(laws, work.slopes, by_strain, work.tangent)


@njit(cache=True, nogil=True)
def _through_laws(laws: Laws, slopes: Floats, by_strain: Floats, tangent: Floats) -> None:
    """Fill the tangent, 1 - law' wrench'."""
    links, columns = len(slopes), by_strain.shape[1]
    for i in range(links):
        for k in range(6):
            row = tangent[6 * i + k]
            row.fill(0.0)
            for m in range(6):
                by_wrench = slopes[i, 1 + m, k] / (laws.scale[i, m] * laws.stiffness[i])
                for column in range(columns):
                    row[column] -= by_wrench * by_strain[6 * i + m, column]
            row[6 * i + k] += 1.0


@njit(cache=True, nogil=True)
def settle(
    chain: CompiledChain, drive: ChainInputs, work: Work, residual: Floats, tolerance: float
) -> tuple[int, float]:
    """Bring the strains so near to equilibrium that one more Newton step ends there; see ``respond``.

    ``residual``, shape (6 links,), is filled with law + eigenstrain - strain at the last iterate.
    """
    length, links = chain.length, len(chain.length)
    size, move = np.inf, np.empty((1, 6 * links))
    for count in range(1, ITERATIONS + 1):
        linearise_chain(chain, drive, work, residual)
        size = 0.0
        for i in range(links):
            for k in range(6):
                # Radians, and translations over the link's length: strains of the same order.
                size = max(size, abs(residual[6 * i + k]) / (1.0 if k < 3 else max(length[i], 1e-3)))
        # NaN, or so far off that no step leads back.
        if not size < 1e3:
            return -count, size
        if size < tolerance:
            return count, size
        for row in range(6 * links):
            move[0, row] = residual[row]
        solve_rows(work.lapack, work.letters, work.tangent, move, work.integers)
        # Half a radian per link and step is as far as the linearisation can be trusted.
        largest = 0.0
        for m in range(6 * links):
            largest = max(largest, abs(move[0, m]))
        factor = min(1.0, 0.5 / largest)
        for i in range(links):
            for k in range(6):
                work.strain[i, k] += factor * move[0, 6 * i + k]
    return -ITERATIONS, size


@njit(cache=True, nogil=True)
def input_gaps(chain: CompiledChain, work: Work, right: Floats) -> None:
    """Fill the change of the laws' strains per unit of each input about a linearised configuration.

    ``right`` holds zeros to begin with, shape (inputs or more, 6 links).
    """
    laws, owner = chain.laws, chain.owner
    links, slopes, chambers = len(work.strain), work.slopes, laws.chambers
    wrench = np.empty((links, 6))
    for i in range(links):
        for n in range(chambers.shape[1]):
            if chambers[i, n] >= 0:
                unit = laws.scale[i, 6 + n] * laws.stiffness[i]
                for k in range(6):
                    right[chambers[i, n], 6 * i + k] = slopes[i, 7 + n, k] / unit
    for u in range(len(owner)):
        wrench.fill(0.0)
        unit_wrenches(
            work.positions, work.middles, chain.actions, owner[u, 0], work.points, chain.units[u], wrench
        )
        for i in range(links):
            for m in range(6):
                unit = laws.scale[i, m] * laws.stiffness[i]
                for k in range(6):
                    right[owner[u, 1], 6 * i + k] += slopes[i, 1 + m, k] / unit * wrench[i, m]


@njit(cache=True, nogil=True)
def stiffness_gaps(laws: Laws, wrench: Floats, pressures: Floats, slopes: Floats, right: Floats) -> None:
    """Fill the change of each link's own strains per unit of its stiffness factor.

    A strain depends on x, the wrench / E and pressures / E, and on 1 / E - 1: its derivative by E is
    -(law' x + law' by the last) / E^2 with x before it is over E.

    ``right`` holds zeros, with a row per link or more.
    """
    last = 7 + laws.chambers.shape[1]
    for i in range(len(wrench)):
        factor = laws.stiffness[i]
        for k in range(6):
            total = slopes[i, last, k]
            for m in range(6):
                total += slopes[i, 1 + m, k] * wrench[i, m] / laws.scale[i, m]
            for n in range(laws.chambers.shape[1]):
                if laws.chambers[i, n] >= 0:
                    total += slopes[i, 7 + n, k] * pressures[laws.chambers[i, n]] / laws.scale[i, 6 + n]
            right[i, 6 * i + k] = -total / (factor * factor)


@njit(cache=True, nogil=True)
def station_twists(motions: Floats, change: Floats, links: Indices, places: Floats, twists: Floats) -> None:
    """Fill the twists of points fixed to stations for changes of the strains.

    Args:
        motions: As of ``link_motion``, shape (links, 6, 12).
        change: Change of the strains, shape (6 links, columns).
        links: Link before each point's station, -1 for the clamp, shape (points,).
        places: Places of the points [m], shape (points, 3).
        twists: Filled with (translation, rotation) of each point, shape (6 points, columns).
    """
    columns = change.shape[1]
    twists.fill(0.0)
    rigid = np.zeros((6, columns))
    for j in range(len(motions)):
        for c in range(6):
            for k in range(6):
                # Many vanish: a translation of a link rotates nothing.
                if motions[j, c, k] != 0.0:
                    for column in range(columns):
                        rigid[k, column] += motions[j, c, k] * change[6 * j + c, column]
        for n in range(len(links)):
            if links[n] == j:
                _point_twist(rigid, places[n], twists[6 * n : 6 * n + 6])


@njit(cache=True, nogil=True)
def _point_twist(rigid: Floats, place: Floats, twist: Floats) -> None:
    """Fill v + w x place and w, with w the first and v the last three rows of a rigid motion."""
    for column in range(rigid.shape[1]):
        w0, w1, w2 = rigid[0, column], rigid[1, column], rigid[2, column]
        twist[0, column] = rigid[3, column] + w1 * place[2] - w2 * place[1]
        twist[1, column] = rigid[4, column] + w2 * place[0] - w0 * place[2]
        twist[2, column] = rigid[5, column] + w0 * place[1] - w1 * place[0]
        twist[3, column] = w0
        twist[4, column] = w1
        twist[5, column] = w2


@njit(cache=True, nogil=True)
def respond(
    chain: CompiledChain,
    drive: ChainInputs,
    tolerance: float,
    work: Work,
    places: Floats,
    change: Floats,
    twists: Floats,
) -> tuple[int, float]:
    """Settle the chain and compute the motion of its points per unit of each input.

    Args:
        chain: The chain.
        drive: Pressures and loads.
        tolerance: Largest residual of a strain [rad, or share of its link's length] to stop at.
        work: Strains to begin with and clamp are given; all is brought to equilibrium.
        places: Filled with the points [m], shape (points, 3).
        change: Filled with the strains' change per unit of each column, shape (6 links, columns): the inputs
            and, where it has more columns, the stiffness factors of the links and the shapes. Without
            columns nothing is differentiated.
        twists: Filled with the points' twists per unit of each, shape (6 points, columns).

    Returns:
        Number of linearisations, negative when it failed, and the last residual.
    """
    laws, inputs, links = chain.laws, chain.inputs, len(chain.length)
    residual, every = np.empty(6 * links), change.shape[1]
    count, size = settle(chain, drive, work, residual, tolerance)
    # One row more than `change` has columns: the last Newton step is solved along with the derivatives.
    right = np.zeros((every + 1, 6 * links))
    for row in range(6 * links):
        right[every, row] = residual[row]
    if every > 0:
        input_gaps(chain, work, right)
    if every > inputs:
        wrench, beyond = np.empty((links, 6)), np.empty((links, 15))
        wrenches(work.positions, work.middles, chain.actions, work.points, drive, wrench, beyond)
        stiffness_gaps(laws, wrench, drive.pressures, work.slopes, right[inputs:])
        for row in range(6 * links):
            for f in range(chain.shapes.shape[1]):
                right[inputs + links + f, row] = chain.shapes[row, f]
    if count > 0:
        # The last Newton step, so small that the linearisation holds at its end as well.
        solve_rows(work.lapack, work.letters, work.tangent, right, work.integers)
        for row in range(6 * links):
            for column in range(every):
                change[row, column] = right[column, row]
            work.strain[row // 6, row % 6] += right[every, row]
        place(work.strain, chain.length, work.rotations, work.positions, work.middles)
    before = np.empty(len(chain.stations), np.int64)
    for n, station in enumerate(chain.stations):
        before[n] = station - 1
        for k in range(3):
            places[n, k] = work.positions[station, k]
        add_rotated(work.rotations[station], chain.offsets[n], places[n])
    if count > 0:
        station_twists(work.motions, change, before, places, twists)
    return count, size


@njit(cache=True, nogil=True)
def respond_all(
    chain: CompiledChain,
    pressures: Floats,
    amplitudes: Floats,
    gravities: Floats,
    eigenstrains: Floats,
    tolerance: float,
    work: Work,
    strains: Floats,
    places: Floats,
    rotations: Floats,
    twists: Floats,
    counts: Indices,
) -> None:
    """Settle the chain, gravity among its inputs, for many samples; arguments as of ``respond``.

    ``amplitudes`` are those of the loads [N or N m], ``eigenstrains`` the sizes of the shapes. ``strains``,
    shape (samples, links, 6), are those to begin with, NaN where a sample begins from the one before; they
    are brought to equilibrium. Filled are ``places``, ``rotations``, shape (samples, points, 3, 3),
    ``twists``, with columns for inputs, links and shapes, and ``counts``, the numbers of linearisations,
    negative where the chain did not settle.
    """
    length, actions, shapes = chain.length, chain.actions, chain.shapes
    units, owner, stations = chain.units, chain.owner, chain.stations
    chambers = pressures.shape[1]
    force, couple = np.zeros((len(actions.link), 3)), np.zeros((len(actions.link), 3))
    change, strain = np.zeros((6 * len(length), twists.shape[2])), np.empty((len(length), 6))
    for s in range(len(pressures)):
        force.fill(0.0)
        couple.fill(0.0)
        for u in range(len(owner)):
            column = owner[u, 1] - chambers
            loads = amplitudes.shape[1]
            size = amplitudes[s, column] if column < loads else gravities[s, column - loads]
            for k in range(3):
                force[owner[u, 0], k] += size * units[u, k]
                couple[owner[u, 0], k] += size * units[u, 3 + k]
        for i in range(len(length)):
            for k in range(6):
                strain[i, k] = 0.0
                for f in range(shapes.shape[1]):
                    strain[i, k] += shapes[6 * i + k, f] * eigenstrains[s, f]
        drive = ChainInputs(pressures[s], force, couple, strain)
        if not np.isnan(strains[s, 0, 0]):
            _copy(strains[s], work.strain)
        for _ in range(2):
            counts[s], _ = respond(chain, drive, tolerance, work, places[s], change, twists[s])
            if counts[s] > 0:
                break
            # From rest once more, before it is given up.
            work.strain.fill(0.0)
        _copy(work.strain, strains[s])
        for n in range(len(stations)):
            _copy(work.rotations[stations[n]], rotations[s, n])


@njit(cache=True, nogil=True)
def _copy(source: Floats, target: Floats) -> None:
    for row in range(source.shape[0]):
        for column in range(source.shape[1]):
            target[row, column] = source[row, column]

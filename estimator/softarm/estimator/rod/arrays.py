"""Named tuples of arrays that the compiled parts of the rod exchange."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.linalg.blas import Letters, load_blas


class Actions(NamedTuple):
    """Where loads and weights act.

    Args:
        link: Link of each action, shape (actions,).
        share: Share of its link at which it sits, 1 for an action on the far station, shape (actions,).
        offset: Place in the far station's frame, for share 1 [m], shape (actions, 3).
        beta: Weights of an action inside its link: lateral force, axial force, moment of the force [m],
            couple, and shear per couple [1/m]; shape (actions, 5).
    """

    link: Indices
    share: Floats
    offset: Floats
    beta: Floats


class Laws(NamedTuple):
    """Link laws.

    Args:
        table: Variables of each term, 0 for the constant 1, shape (terms, 4).
        coefficients: Strains per term, shape (links, terms, 8).
        chambers: Chambers around each link, -1 where there are fewer, shape (links, width).
        scale: Unit of each wrench component [N, N m], then of each pressure [Pa], shape (links, 6 + width).
        reach: Largest size of each in the fit, at unit stiffness, of the same shape.
        stiffness: Factor on the stiffness of each link, shape (links,).
    """

    table: Indices
    coefficients: Floats
    chambers: Indices
    scale: Floats
    reach: Floats
    stiffness: Floats


class CompiledChain(NamedTuple):
    """What of a chain does not change from sample to sample.

    Args:
        length: Rest lengths of the links [m], shape (links,).
        actions: Where weights and loads act.
        laws: Link laws.
        inputs: Number of inputs: pressures, loads and, where they are some, the components of gravity.
        units: Force and couple of an action per unit of an input, shape (units, 6).
        owner: Action and input of each, shape (units, 2).
        shapes: Eigenstrains of the links whose effect is wanted, shape (6 links, shapes).
        stations: Station of each point whose motion is wanted, 0 for the clamp, shape (points,).
        offsets: Offset of each point in its station's frame [m], shape (points, 3).
    """

    length: Floats
    actions: Actions
    laws: Laws
    inputs: int
    units: Floats
    owner: Indices
    shapes: Floats
    stations: Indices
    offsets: Floats


class ChainInputs(NamedTuple):
    """What drives the chain.

    Args:
        pressures: Gauge pressures [Pa], shape (chambers,).
        force: Force of each action in the base frame [N], shape (actions, 3).
        couple: Couple of each action [N m], shape (actions, 3).
        eigenstrain: Strain of each link beside what its law gives, shape (links, 6).
    """

    pressures: Floats
    force: Floats
    couple: Floats
    eigenstrain: Floats


class Work(NamedTuple):
    """A configuration and what was evaluated there.

    Args:
        strain: theta [rad], then t [m] of each link, shape (links, 6).
        rotations: Frames of the stations, the clamp first, shape (links + 1, 3, 3).
        positions: Their origins [m], shape (links + 1, 3).
        middles: R_mid of each link, shape (links, 3, 3).
        points: Places of the actions [m], shape (actions, 3).
        motions: Motion by each strain, as of ``link_motion``, shape (links, 6, 12).
        slopes: Derivatives of the laws by their variables, shape (links, 8 + width, 8).
        tangent: Derivative of strain - law by the strains, shape (6 links, 6 links).
        lapack: Addresses of its routines.
        letters: Their option letters.
        integers: Their memory, shape (3 + 6 links,).
    """

    strain: Floats
    rotations: Floats
    positions: Floats
    middles: Floats
    points: Floats
    motions: Floats
    slopes: Floats
    tangent: Floats
    lapack: Indices
    letters: Letters
    integers: NDArray[np.int32]


def new_work(links: int, actions: int, width: int) -> Work:
    """Allocate memory for a chain at rest."""
    rotations = np.zeros((links + 1, 3, 3))
    rotations[0] = np.eye(3)
    return Work(
        strain=np.zeros((links, 6)),
        rotations=rotations,
        positions=np.zeros((links + 1, 3)),
        middles=np.zeros((links, 3, 3)),
        points=np.zeros((actions, 3)),
        motions=np.zeros((links, 6, 12)),
        slopes=np.zeros((links, 8 + width, 8)),
        tangent=np.zeros((6 * links, 6 * links)),
        lapack=load_blas().addresses,
        letters=load_blas().letters,
        integers=np.zeros(3 + 6 * links, dtype=np.int32),
    )

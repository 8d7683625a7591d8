"""Model form: what any smooth law of pressures and strains could change of each segment's eigenstrains.

A model of walls and windings is never exact. Where nominal recordings show the arm, the error of its law is
learnt from them as eps_i = u_i + sum_k c_ik phi_k, with phi_k the monomials up to the third degree in the
pressures of the segment's own chambers and those of its strains that gravity shows. Lines to other segments
pass a segment as well, and no two chambers are quite apart: a share of each pressure acts in every chamber
of another segment, as the calibration has it. The form has no memory and no clock in it, and it is common to
all recordings, so that nothing new can hide in it.
"""

from itertools import combinations_with_replacement, permutations

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.layout import CROSSTALK_SPREAD
from softarm.estimator.diagnosis.stage import Stage

DEGREE = 3
PRESSURE = 50e3
"""Pressure [Pa] and strain [rad] at which a monomial is 1."""
STRAIN = 0.5
ELONGATION = 0.02
"""Elongation [m] that stands beside a strain of ``STRAIN``."""
CLOCK = 0.03
"""Standard deviation of the delay between the clocks of pressures and motion [s]."""
SPREAD = 0.04
"""Standard deviation of each coefficient, in strains of ``STRAIN`` at monomials of 1."""


def form_columns(stage: Stage) -> Floats:
    """Return the change of the predictions per unit of each coefficient, that of the clock last.

    Returns:
        Shape (samples, rows, columns).
    """
    by_eigenstrain = stage.by_eigenstrain
    size = np.array([STRAIN, STRAIN, STRAIN, ELONGATION])
    columns = []
    for g in range(len(stage.world.segments)):
        features = monomials(stage, g)
        for axis in range(4):
            jacobian = SPREAD * size[axis] * by_eigenstrain[..., 4 * g + axis]
            columns.append(jacobian[..., None] * features[:, None, :])
    columns += [CROSSTALK_SPREAD * column[..., None] for column in crosstalk(stage)]
    predicted = np.nan_to_num(stage.reading_rows - stage.residual)
    late = -CLOCK * np.gradient(predicted, stage.session.clock, axis=0)
    return np.concatenate([*columns, late[..., None]], axis=-1)


def crosstalk(stage: Stage) -> list[Floats]:
    """Let each pressure act in every chamber of other segments, each of shape (samples, rows)."""
    owner, pressures = stage.world.chamber_segment, stage.session.pressures
    return [
        stage.input_jacobian[..., acts_in] * pressures[:, comes_from, None]
        for acts_in, comes_from in permutations(range(len(owner)), 2)
        if owner[acts_in] != owner[comes_from]
    ]


def monomials(stage: Stage, segment: int) -> Floats:
    """Evaluate the monomials of a segment, shape (samples, monomials)."""
    members = [k for k, own in enumerate(stage.world.chamber_segment) if own == segment]
    pressures = stage.session.pressures[:, members] / PRESSURE
    strains = stage.arm.baseline.strains[:, segment, :3] / STRAIN
    products = [
        np.prod(pressures[:, list(term)], axis=1)
        for degree in range(1, DEGREE + 1)
        for term in combinations_with_replacement(range(len(members)), degree)
    ]
    products += [strains[:, k] for k in range(3)]
    products += [strains[:, j] * strains[:, k] for j, k in combinations_with_replacement(range(2), 2)]
    products += [strains[:, j] * pressures[:, k] for j in range(2) for k in range(len(members))]
    return np.stack(products, axis=-1)

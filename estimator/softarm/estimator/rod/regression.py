"""Fits the link laws to samples by least squares on strains and on their derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.rod.arrays import Laws
from softarm.estimator.rod.chain import Chain
from softarm.estimator.rod.laws import OUTPUTS, feature_slopes, features, term_table
from softarm.estimator.rod.local import LocalStates
from softarm.estimator.rod.samples import Samples
from softarm.estimator.rod.symmetry import Symmetry, feature_map, variable_map

FAR = 1.5
"""Sum of the links' bends [rad] at which a sample counts half."""
LONGEST = 0.3
"""Change of a law's variables, over their range, that counts most in the fit of derivatives."""


@dataclass(frozen=True)
class Form:
    """Form of the link laws.

    Args:
        total: Largest degree of a general term.
        pressure_total: Largest degree of a term of pressures alone.
        mixed: Degrees in the wrench and in the pressures of more families of terms.
        scaled: Whether terms up to the second degree change with the stiffness factor.
        slope_weight: Weight of a derivative against a value, both over their typical size.
        ridge: Share of the mean curvature that is added against terms that the samples do not separate.
    """

    total: int = 3
    pressure_total: int = 4
    mixed: tuple[tuple[int, int], ...] = ((1, 3),)
    scaled: bool = True
    slope_weight: float = 0.5
    ridge: float = 1e-9


def fit_laws(
    chain: Chain,
    samples: Samples,
    states: LocalStates,
    input_size: Floats,
    symmetries: Sequence[Symmetry],
    form: Form,
) -> Laws:
    """Fit the laws of all links.

    Args:
        chain: The links.
        samples: States of the finite-element model.
        states: Their strains and wrenches.
        input_size: Typical change of each input, shape (inputs,).
        symmetries: Symmetries of the arm.
        form: Form of the laws.

    Returns:
        The laws with unit stiffness factors.
    """
    width = chain.chambers.shape[1]
    feature_maps: dict[bytes, Floats] = {}
    trust = _trust(samples, states)
    table = term_table(6, width, form.total, form.pressure_total, form.mixed, form.scaled)
    coefficients = np.zeros((chain.links, len(table), OUTPUTS))
    scale, reach = np.ones((chain.links, 6 + width)), np.zeros((chain.links, 6 + width))
    for link in range(chain.links):
        near = chain.chambers[link][chain.chambers[link] >= 0]
        variables, slopes = _variables(samples, states, near, link, width)
        reach[link] = np.abs(variables[:, :-1]).max(axis=0)
        scale[link] = _isotropic(reach[link], len(near))
        unit = np.append(scale[link], 1.0)
        coefficients[link, :, :6] = _fit_link(
            table,
            variables / unit,
            slopes / unit[:, None] * input_size,
            states.strains[:, link],
            states.strain_slopes[:, link] * input_size,
            [variable_map(symmetry, near, scale[link][: 6 + len(near)]) for symmetry in symmetries],
            form,
            trust,
            feature_maps,
        )
    return Laws(table, coefficients, chain.chambers, scale, reach, np.ones(chain.links))


def _trust(samples: Samples, states: LocalStates) -> Floats:
    """Compute the samples' weights: the softer the arm, the less force an error of strain stands for.

    Where the arm bends far beyond ``FAR`` the laws need not be as near.
    """
    bend = np.linalg.norm(states.strains[..., :3], axis=-1).sum(axis=1)
    trust: Floats = 1.0 / (samples.softness * (1.0 + (bend / FAR) ** 2))
    return trust


def _variables(
    samples: Samples, states: LocalStates, near: Indices, link: int, width: int
) -> tuple[Floats, Floats]:
    """Compute a law's variables before scaling, padded with zeros, and their derivatives by the inputs."""
    inputs = states.wrench_slopes.shape[-1]
    variables = np.zeros((len(samples), 7 + width))
    slopes = np.zeros((len(samples), 7 + width, inputs))
    variables[:, :6], slopes[:, :6] = states.wrenches[:, link], states.wrench_slopes[:, link]
    variables[:, 6 : 6 + len(near)] = samples.pressures[:, near]
    slopes[:, 6 + np.arange(len(near)), near] = 1.0
    factor = samples.factors[:, link, None]
    variables[:, :-1] /= factor
    slopes /= factor[..., None]
    variables[:, -1] = 1.0 / factor[:, 0] - 1.0
    return variables, slopes


def _isotropic(largest: Floats, chambers: int) -> Floats:
    """Set the units: one for variables that symmetries mix, and 1 for those that are always zero."""
    unit = np.ones_like(largest)
    # Lateral forces, axial force, bending moments, torque, pressures.
    for group in (slice(0, 2), slice(2, 3), slice(3, 5), slice(5, 6), slice(6, 6 + chambers)):
        if largest[group].size:
            unit[group] = max(float(largest[group].max()), 1e-9)
    return unit


def _moderated(slopes: Floats) -> Floats:
    """Shorten changes of the variables, shape (samples, variables, inputs), to ``LONGEST``.

    Near the loss of stability a small input moves the arm far; what the linearised law errs there must not
    drown all the rest.
    """
    size = np.abs(slopes).max(axis=1)
    moderated: Floats = LONGEST / np.maximum(size, LONGEST)
    return moderated


def _fit_link(
    table: Indices,
    variables: Floats,
    slopes: Floats,
    strains: Floats,
    strain_slopes: Floats,
    maps: Sequence[Floats | None],
    form: Form,
    trust: Floats,
    feature_maps: dict[bytes, Floats],
) -> Floats:
    """Fit one law, shape (terms, 6); every symmetry adds the moved samples to the normal equations.

    Samples have weights ``trust``, shape (samples,).
    """
    width = variables.shape[1]
    rows = trust[:, None] * features(table, variables)
    normal, right = rows.T @ rows, rows.T @ (trust[:, None] * strains)
    # Derivatives count beside values: they determine the law between the rays, where no state was solved.
    weights = form.slope_weight * _moderated(slopes) * trust[:, None]
    for column in range(slopes.shape[-1]):
        weight = weights[:, column, None]
        rows = weight * feature_slopes(table, variables, slopes[..., column])
        normal += rows.T @ rows
        right += rows.T @ (weight * strain_slopes[..., column])
    total, total_right = np.zeros_like(normal), np.zeros_like(right)
    for moved in maps:
        if moved is None:
            continue
        whole = np.eye(width)
        whole[: len(moved), : len(moved)] = moved
        matrix = feature_maps.get(whole.tobytes())
        if matrix is None:
            matrix = feature_maps[whole.tobytes()] = feature_map(table, whole)
        outputs = np.zeros((6, 6))
        # A strain is (rotation, translation), a wrench (force, moment): their maps are swapped. Scaling
        # leaves both blocks as they are, since x and y share a unit.
        outputs[:3, :3], outputs[3:, 3:] = moved[3:6, 3:6], moved[:3, :3]
        # A symmetry maps features linearly: the normal equations are moved in place of every sample.
        total += matrix @ normal @ matrix.T
        total_right += matrix @ right @ outputs.T
    total[np.diag_indices(len(total))] += form.ridge * np.trace(total) / len(total)
    return np.asarray(np.linalg.solve(total, total_right), dtype=np.float64)

"""How segments yield to their own couples in every pose, and how eigenstrains move the sections."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.simulation.segments import Segments

SPREAD = 8.0
"""Factor by which a segment's stiffness may differ between poses; more means that the model is lost."""


def stiffness_along(segments: Segments, frames: Frames, by_wrench: Floats) -> Floats:
    """Return each segment's stiffness against its own couples in every pose, shape (samples, segments, 4, 4).

    It is the inverse of the tangent compliance, kept within ``SPREAD`` of the typical one.

    Args:
        segments: The segments.
        frames: Frames of the sections, arrays with a leading axis (samples,).
        by_wrench: ``ArmResponse.load_jacobian`` of a model whose loads are ``section_loads``.
    """
    rows = segments.rows(frames)
    compliance = np.einsum("tgai,tij,tgbj->tgab", rows, by_wrench, rows)
    typical = np.abs(np.median(np.diagonal(compliance, axis1=2, axis2=3), axis=0))
    return bounded_inverse(compliance, 1.0 / np.maximum(typical, 1e-24))


def bounded_inverse(compliance: Floats, usual: Floats) -> Floats:
    """Return the stiffness of each segment, kept within ``SPREAD`` of the usual one.

    Args:
        compliance: Tangent compliance against the segment's own couples, shape (..., segments, 4, 4).
        usual: Usual stiffness, shape (segments, 4).
    """
    size = np.sqrt(usual)
    scaled = compliance * size[:, :, None] * size[:, None, :]
    values, vectors = np.linalg.eigh(0.5 * (scaled + np.swapaxes(scaled, -1, -2)))
    bounded = np.clip(values, 1.0 / SPREAD, SPREAD)[..., None, :]
    stiffness: Floats = (vectors / bounded) @ np.swapaxes(vectors, -1, -2)
    return stiffness * size[:, :, None] * size[:, None, :]


def yielding(segments: Segments, frames: Frames, by_wrench: Floats) -> Floats:
    """Return the twists of sections per unit of eigenstrains that act as couples.

    Returns:
        Shape (samples, 6 sections, 4 segments).
    """
    samples = len(frames.positions)
    by_couple = by_wrench @ np.swapaxes(segments.rows(frames).reshape(samples, -1, by_wrench.shape[-1]), 1, 2)
    each = by_couple.reshape(samples, -1, segments.count, 4)
    stiffness = stiffness_along(segments, frames, by_wrench)
    by_eigenstrain = np.einsum("trgi,tgij->trgj", each, stiffness)
    return np.asarray(by_eigenstrain.reshape(samples, by_couple.shape[1], -1))

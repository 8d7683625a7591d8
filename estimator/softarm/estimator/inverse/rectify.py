"""Rectification: the alignment of the sensors from readings of the arm at rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames
from softarm.estimator.sensing import Scene, SensorSuite

Floats = NDArray[np.float64]

REST_PARAMETERS = (
    "misalignment_x",
    "misalignment_y",
    "misalignment_z",
    "offset_x",
    "offset_y",
    "offset_z",
    "bias_x",
    "bias_y",
)
"""Alignment that a single pose determines: what the paper rectifies per section, and the bias of bends."""


@dataclass(frozen=True)
class Rectified:
    """Aligned sensors.

    Args:
        suite: The sensors with the alignment found.
        names: Names of the parameters found, ``<sensor>.<parameter>``.
        values: Their values, shape (parameters,).
        covariance: Their covariance, shape (parameters, parameters).
        residual_rms: Root mean square of the whitened residual, 1 where noise is as assumed.
        iterations: Number of Gauss-Newton steps.
    """

    suite: SensorSuite
    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    residual_rms: float
    iterations: int


def rectify(
    suite: SensorSuite, frames: Frames, readings: Floats, parameters: Sequence[str] = REST_PARAMETERS
) -> Rectified:
    """Fit alignment parameters to readings of known frames, by Gauss-Newton.

    The covariance is that of the least-squares fit, widened by the scatter of the readings where that is
    larger than their assumed noise.

    Args:
        suite: The sensors.
        frames: The model's frames: of one rest pose, or with one leading axis (samples,).
        readings: Stacked readings, NaN where absent, shape (samples, readings).
        parameters: Names of the parameters to fit, ``<parameter>`` for every sensor that has it or
            ``<sensor>.<parameter>``.

    Raises:
        InputError: If nothing is to be fitted, or the readings do not determine it.
    """
    wanted = np.array(
        [
            k
            for k, name in enumerate(suite.parameter_names)
            if name in parameters or name.split(".")[-1] in parameters
        ]
    )
    samples = len(readings)
    if not len(wanted):
        raise InputError("rectification", f"no sensor has {', '.join(parameters)}", "name other parameters")
    scene = Scene(
        Frames(
            np.broadcast_to(frames.positions, (samples, *frames.positions.shape[-2:])),
            np.broadcast_to(frames.rotations, (samples, *frames.rotations.shape[-3:])),
        ),
        np.zeros((samples, 0)),
    )
    converged, iterations = False, 0
    while not converged and iterations < 20:
        iterations += 1
        normal, gradient, cost, rows = _normal_equations(suite, scene, readings, wanted)
        _require_determined(suite, normal, wanted)
        step = np.linalg.solve(normal, gradient)
        values = suite.parameters
        values[wanted] += step
        suite = suite.with_parameters(values)
        converged = bool(step @ normal @ step < 1e-12 * rows)
    freedom = max(rows - len(wanted), 1)
    scatter = max(float(cost - gradient @ step) / freedom, 0.0)
    names = tuple(suite.parameter_names[k] for k in wanted)
    covariance = np.asarray(np.linalg.inv(normal) * max(scatter, 1.0), dtype=np.float64)
    return Rectified(suite, names, suite.parameters[wanted], covariance, float(np.sqrt(scatter)), iterations)


def _normal_equations(
    suite: SensorSuite, scene: Scene, readings: Floats, wanted: NDArray[np.int64]
) -> tuple[Floats, Floats, float, int]:
    sensitivity = suite.sensitivity(scene, readings)
    seen = np.isfinite(sensitivity.innovation)
    innovation = np.where(seen, sensitivity.innovation, 0.0)
    jacobian = np.where(seen[..., None], suite.parameter_rows(scene, readings)[..., wanted], 0.0)
    covariance = suite.covariance(scene, np.nan_to_num(readings), np.nan_to_num(sensitivity.twists))
    information = np.linalg.inv(covariance)
    weighted = np.einsum("sra,srq->saq", jacobian, information)
    normal = np.einsum("saq,sqb->ab", weighted, jacobian)
    gradient = np.einsum("saq,sq->a", weighted, innovation)
    cost = float(np.einsum("sr,srq,sq->", innovation, information, innovation))
    return normal, gradient, cost, int(seen.sum())


def _require_determined(suite: SensorSuite, normal: Floats, wanted: NDArray[np.int64]) -> None:
    size = np.sqrt(np.diag(normal))
    lost = np.flatnonzero(size == 0)
    scaled = normal / np.outer(np.maximum(size, 1e-300), np.maximum(size, 1e-300))
    values, vectors = np.linalg.eigh(scaled)
    if len(lost) or values[0] < 1e-9:
        worst = int(lost[0]) if len(lost) else int(np.argmax(np.abs(vectors[:, 0])))
        name = suite.parameter_names[wanted[worst]]
        raise InputError(
            "rectification", f"the readings do not determine {name}", "leave it out or record more poses"
        )

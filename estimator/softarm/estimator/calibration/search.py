"""Global search for the alignment of bend axes: in-plane rotation and handedness, in closed form.

With b the model's bend as a complex number and y the recorded one, y = a b + c, or a conj(b) + c where the
recorded axes are left-handed; a = g exp(i phi) holds the in-plane rotation phi and a gain g, c the bias. Both
fits are linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.model import Frames
from softarm.estimator.sensing import Bend, SensorSuite


@dataclass(frozen=True)
class AxesFit:
    """What fits a bend's recorded axes for one handedness.

    Args:
        mirrored: Whether the axes are left-handed.
        in_plane: Rotation [rad].
        gain: Recorded over predicted size of the bend.
        bias: Offset [rad], shape (2,).
        rms: What is left [rad].
    """

    mirrored: bool
    in_plane: float
    gain: float
    bias: Floats
    rms: float


def fit_axes(predicted: Floats, recorded: Floats, weights: Floats, mirrored: bool) -> AxesFit:
    """Fit rotation, gain and bias for one handedness.

    Args:
        predicted: The model's bends in its own axes [rad], shape (nodes, 2).
        recorded: The recorded bends [rad], shape (nodes, 2).
        weights: Shape (nodes,).
        mirrored: The handedness.
    """
    model = predicted[:, 0] + 1j * predicted[:, 1] * (-1.0 if mirrored else 1.0)
    data = recorded[:, 0] + 1j * recorded[:, 1]
    root = np.sqrt(weights)
    columns = np.column_stack([model, np.ones_like(model)]) * root[:, None]
    (factor, bias), *_ = np.linalg.lstsq(columns, data * root, rcond=None)
    residual = data - factor * model - bias
    rms = float(np.sqrt((weights * np.abs(residual) ** 2).sum() / max(2.0 * weights.sum(), 1e-12)))
    offset = np.array([bias.real, bias.imag])
    return AxesFit(mirrored, float(np.angle(factor)), float(np.abs(factor)), offset, rms)


def search_axes(suite: SensorSuite, nodes: Sequence[Nodes], frames: Sequence[Frames]) -> dict[str, AxesFit]:
    """Find each bend's axes, by the sensor's name; all share one handedness, that which leaves least."""
    sensors = [sensor for sensor in suite.measurements if isinstance(sensor, Bend)]
    best: dict[str, AxesFit] = {}
    least = np.inf
    for mirrored in (False, True):
        fits = {sensor.name: _fit_sensor(sensor, nodes, frames, mirrored) for sensor in sensors}
        total = sum(fitted.rms**2 for fitted in fits.values())
        if total < least:
            best, least = fits, total
    return best


def _fit_sensor(sensor: Bend, nodes: Sequence[Nodes], frames: Sequence[Frames], mirrored: bool) -> AxesFit:
    # What is sought must not be in the prediction already.
    plain = replace(sensor, in_plane=0.0, bias=np.zeros(2), mirrored=False)
    predicted, recorded, weights = [], [], []
    for run_nodes, observed in zip(nodes, frames, strict=True):
        part = run_nodes.run.suite.reading_slices.get(sensor.name)
        if part is None:
            continue
        readings = run_nodes.readings[:, part]
        present = np.isfinite(readings).all(axis=1)
        predicted.append(plain.predict(observed)[present])
        recorded.append(readings[present])
        weights.append(run_nodes.weights[present])
    return fit_axes(np.concatenate(predicted), np.concatenate(recorded), np.concatenate(weights), mirrored)

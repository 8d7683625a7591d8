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
from softarm.estimator.calibration.significance import NODES_PER_FREEDOM, scatter_limit
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
        recorded: The recorded bends [rad], NaN where lost, shape (nodes, 2).
        weights: Shape (nodes,).
        mirrored: The handedness.
    """
    # x' = c x - s y + b_x and y' = s x + c y + b_y: either axis alone determines c and s.
    x, y = predicted[:, 0], predicted[:, 1] * (-1.0 if mirrored else 1.0)
    one, none = np.ones_like(x), np.zeros_like(x)
    columns = np.concatenate([np.column_stack([x, -y, one, none]), np.column_stack([y, x, none, one])])
    data, doubled = recorded.T.ravel(), np.concatenate([weights, weights])
    read = np.isfinite(data)
    columns, data, doubled = columns[read], data[read], doubled[read]
    root = np.sqrt(doubled)
    (cosine, sine, *offset), *_ = np.linalg.lstsq(columns * root[:, None], data * root, rcond=None)
    residual = data - columns @ np.array([cosine, sine, *offset])
    rms = float(np.sqrt((doubled * residual**2).sum() / max(doubled.sum(), 1e-12)))
    angle, gain = float(np.arctan2(sine, cosine)), float(np.hypot(cosine, sine))
    return AxesFit(mirrored, angle, gain, np.array(offset), rms)


def search_axes(suite: SensorSuite, nodes: Sequence[Nodes], frames: Sequence[Frames]) -> dict[str, AxesFit]:
    """Find each bend's axes, by the sensor's name.

    Sensors of one make have one handedness, that which leaves least of all. A sensor has the other one where
    that leaves significantly less: an axis of it was mounted or wired the other way.
    """
    sensors = [sensor for sensor in suite.measurements if isinstance(sensor, Bend)]
    fits = [
        {sensor.name: _fit_sensor(sensor, nodes, frames, mirrored) for sensor in sensors}
        for mirrored in (False, True)
    ]
    common, other = sorted(fits, key=lambda one: sum(fitted.rms**2 for fitted in one.values()))
    # Each node has two angles of a sensor.
    freedom = max(2.0 * sum(len(run_nodes.time) for run_nodes in nodes) / NODES_PER_FREEDOM, 1.0)
    limit = scatter_limit(freedom, freedom)
    return {
        name: other[name] if fitted.rms > limit * other[name].rms else fitted
        for name, fitted in common.items()
    }


def _fit_sensor(sensor: Bend, nodes: Sequence[Nodes], frames: Sequence[Frames], mirrored: bool) -> AxesFit:
    # What is sought must not be in the prediction already.
    plain = replace(sensor, in_plane=0.0, bias=np.zeros(2), mirrored=False)
    predicted, recorded, weights = [], [], []
    for run_nodes, observed in zip(nodes, frames, strict=True):
        part = run_nodes.run.suite.reading_slices.get(sensor.name)
        if part is None:
            continue
        predicted.append(plain.predict(observed))
        recorded.append(run_nodes.readings[:, part])
        weights.append(run_nodes.weights)
    return fit_axes(np.concatenate(predicted), np.concatenate(recorded), np.concatenate(weights), mirrored)

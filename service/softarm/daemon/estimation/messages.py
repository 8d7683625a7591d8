"""What travels between the control process and the estimator's process."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse import ContactPlace


class _Compact:
    """Pickles arrays as bytes: numpy's own way costs most of the time of such a message."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        arrays, others = {}, {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                # A bytearray, because an array that is made of bytes is read-only.
                arrays[name] = value.dtype.char, value.shape, bytearray(value)
            else:
                others[name] = value
        return _restored, (type(self), arrays, others)


def _restored(
    kind: type, arrays: Mapping[str, tuple[str, tuple[int, ...], bytearray]], others: Mapping[str, Any]
) -> Any:
    message: Any = object.__new__(kind)
    vars(message).update(others)
    for name, (dtype, shape, data) in arrays.items():
        vars(message)[name] = np.frombuffer(data, dtype).reshape(shape)
    return message


@dataclass(frozen=True)
class PoseTarget:
    """A pose to hold.

    Args:
        positions: Section origins in the base frame [m], shape (sections, 3).
        quaternions: Section orientations (w, x, y, z), shape (sections, 4).
        residuals: Residuals of the estimate there, by sensor.
    """

    positions: Floats
    quaternions: Floats
    residuals: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True)
class EstimationRequest(_Compact):
    """One time-aligned set of readings.

    Args:
        time_s: When the readings were measured, on the service's monotonic clock [s].
        newest_arrival_ns: Monotonic time at which the newest of them arrived.
        readings: Stacked in the order of the sensors, NaN where absent, shape (readings,).
        pressures: Measured gauge pressures [Pa], NaN where lost, shape (chambers,).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
        used: Names of the sensors in the readings.
        lost: Names of those that are absent.
        with_hold: Whether to find the pressures that hold the pose.
        target: The pose that is being held.
        with_mesh: Whether to send the positions of the surface's nodes.
        with_contact: Whether to place a push along the arm.
        tare: Load amplitudes that count as zero, shape (loads,); needed to place a push.
    """

    time_s: float
    newest_arrival_ns: int
    readings: Floats
    pressures: Floats
    gravity: Floats
    used: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    with_hold: bool = False
    target: PoseTarget | None = None
    with_mesh: bool = False
    with_contact: bool = False
    tare: Floats | None = None


@dataclass(frozen=True)
class HoldAnswer:
    """Pressures that would hold the measured pose without an external force.

    Args:
        pressures: As commanded to the valves, gauge [Pa], shape (chambers,).
        reachable: Whether they hold it within the sensors' noise.
        note: What limits the arm, in words.
        valid: Whether there is an answer; otherwise the pressures mean nothing and only the note counts.
        towards: Change of the commanded pressures that would bring the arm to the target [Pa], shape
            (chambers,); ``None`` without a target.
        residuals: Residuals of the estimate in the measured pose, by sensor.
    """

    pressures: Floats
    reachable: bool
    note: str
    valid: bool = True
    towards: Floats | None = None
    residuals: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True)
class EstimationResult(_Compact):
    """Result of the estimator for one request.

    Args:
        request: What it answers.
        converged: Whether the search converged.
        model: On which model it ran.
        loads: Amplitudes of the model's loads [N or N m], shape (loads,).
        load_covariance: Shape (loads, loads).
        positions: Section origins in the base frame [m], shape (sections, 3).
        quaternions: Section orientations (w, x, y, z), shape (sections, 4).
        frame_std: Standard deviation of each section's twist [m, rad], shape (sections, 6).
        innovation_squared: Normalised innovation squared.
        degrees_of_freedom: Its expectation when the model is right.
        sensor_innovations: Root mean square of each sensor's residual over its standard deviation.
        unobservable: What these readings do not determine, in words.
        hold: Pressures that hold the pose, when requested.
        contact: Place of a single push, when requested and observable.
        nodes: Position [m] and stress [Pa] of the surface's nodes, shape (nodes, 4), when requested.
        solve_s: Time taken.
        rod_off_rad: Angle by which the calibrated rod was off the finite elements when last compared.
    """

    request: EstimationRequest
    converged: bool
    model: Literal["fem", "rod"]
    loads: Floats
    load_covariance: Floats
    positions: Floats
    quaternions: Floats
    frame_std: Floats
    innovation_squared: float
    degrees_of_freedom: float
    sensor_innovations: dict[str, float] = field(default_factory=dict)
    unobservable: tuple[str, ...] = ()
    hold: HoldAnswer | None = None
    contact: ContactPlace | None = None
    nodes: NDArray[np.float32] | None = None
    solve_s: float = 0.0
    rod_off_rad: float | None = None

    @property
    def finite(self) -> bool:
        """Whether it is made of numbers; that of a search that diverged is not."""
        parts = (self.loads, self.load_covariance, self.positions, self.quaternions, self.frame_std)
        judged = (self.innovation_squared, self.degrees_of_freedom)
        return all(bool(np.isfinite(part).all()) for part in (*parts, judged))

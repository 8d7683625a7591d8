"""Exact steps of linear filters whose input runs straight between samples.

A filter begins in equilibrium with its first input. Its memory holds time, input and state of the last
sample, so that a stretch cut in two gives the same as the whole.
"""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats

Memory = tuple[Floats, ...]


def first_order(time: Floats, values: Floats, lag: float, memory: Memory) -> tuple[Floats, Memory]:
    """Follow values by lag z' = u - z.

    With u from u0 to u1 at slope s over h: z1 = u1 - lag s + (z0 - u0 + lag s) exp(-h / lag).

    Args:
        time: Seconds, shape (samples,).
        values: Input u, shape (samples, ...).
        lag: Time constant [s]; 0 follows at once.
        memory: Memory of the stretch before.

    Returns:
        The output, shape (samples, ...), and the memory.
    """
    if lag <= 0.0:
        return values, (time[-1:], values[-1], values[-1])
    when, before, state = memory or (time[:1], values[0], values[0])
    times, inputs = np.concatenate((when, time)), np.concatenate((before[None], values))
    steps, change, start = times[1:] - times[:-1], inputs[1:] - inputs[:-1], inputs[:-1]
    wide = np.where(steps > 0.0, steps, 1.0).reshape(-1, *(1,) * (values.ndim - 1))
    behind = (lag * change / wide).reshape(len(time), -1)
    kept = np.exp(-steps / lag)
    ahead = values.reshape(len(time), -1) - behind
    ahead -= kept[:, None] * (start.reshape(len(time), -1) - behind)
    out: Floats = recursion(kept, ahead, np.ravel(state).astype(np.float64)).reshape(values.shape)
    return out, (time[-1:], values[-1], out[-1].copy())


@njit(cache=True, nogil=True)
def recursion(kept: Floats, ahead: Floats, state: Floats) -> Floats:
    """Return z_k = kept_k z_(k-1) + ahead_k of several columns.

    Args:
        kept: Shape (samples,).
        ahead: Shape (samples, columns).
        state: The columns before the first sample, shape (columns,); overwritten.

    Returns:
        z, shape (samples, columns).
    """
    out = np.empty_like(ahead)
    for k in range(len(kept)):
        for j in range(len(state)):
            state[j] = kept[k] * state[j] + ahead[k, j]
            out[k, j] = state[j]
    return out


def second_order(
    time: Floats, values: Floats, inertia: float, damping: float, memory: Memory
) -> tuple[Floats, Memory]:
    """Follow values by inertia^2 x'' + damping x' + x = u, at rest with the first input.

    Args:
        time: Seconds, shape (samples,).
        values: Input u, shape (samples, ...).
        inertia: Inverse of the undamped angular frequency [s]; 0 leaves the first-order filter.
        damping: Damping time [s].
        memory: Memory of the stretch before: time, input, x and x'.

    Returns:
        The output, shape (samples, ...), and the memory.
    """
    if inertia <= 0.0:
        out, velocity = first_order(time, values, damping, memory[:3])
        return out, (*velocity, np.zeros_like(velocity[2]))
    when, before, state, speed = memory or (time[:1], values[0], values[0], np.zeros_like(values[0]))
    steps = np.diff(time, prepend=when)
    inputs = np.concatenate((before[None], values)).reshape(len(values) + 1, -1)
    states = np.stack([np.ravel(state), np.ravel(speed)]).astype(np.float64)
    out = _oscillation(steps, _propagators(steps, inertia, damping), inputs, damping, states)
    state, speed = states.reshape(2, *values.shape[1:])
    return out.reshape(values.shape), (time[-1:], values[-1], state, speed)


@njit(cache=True, nogil=True)
def _oscillation(steps: Floats, move: Floats, inputs: Floats, damping: float, states: Floats) -> Floats:
    """Step oscillators through all samples.

    Args:
        steps: Time since the sample before [s], shape (samples,).
        move: As of ``_propagators``.
        inputs: Of the sample before the first, and of all samples, shape (samples + 1, columns).
        damping: Damping time [s].
        states: Place and speed before the first sample, shape (2, columns); overwritten.

    Returns:
        Places, shape (samples, columns).
    """
    out = np.empty_like(inputs[1:])
    for k in range(len(steps)):
        for j in range(out.shape[1]):
            if steps[k] > 0.0:
                slope = (inputs[k + 1, j] - inputs[k, j]) / steps[k]
                jump, drift = states[0, j] - inputs[k, j] + damping * slope, states[1, j] - slope
                states[0, j] = (
                    inputs[k + 1, j] - damping * slope + move[k, 0, 0] * jump + move[k, 0, 1] * drift
                )
                states[1, j] = slope + move[k, 1, 0] * jump + move[k, 1, 1] * drift
            out[k, j] = states[0, j]
    return out


def _propagators(steps: Floats, inertia: float, damping: float) -> Floats:
    """Return exp(A h) of x'' = -(damping x' + x) / inertia^2 for each step h, shape (steps, 2, 2)."""
    decay = 0.5 * damping / inertia**2
    root = np.sqrt(complex(decay**2 - inertia**-2))
    root = root if abs(root) > 1e-6 / inertia else complex(1e-6 / inertia)
    slow, fast = np.exp((root - decay) * steps), np.exp((-root - decay) * steps)
    sine, cosine = ((slow - fast) / (2.0 * root)).real, ((slow + fast) / 2.0).real
    rows = [[cosine + decay * sine, sine], [-sine / inertia**2, cosine - decay * sine]]
    return np.moveaxis(np.array(rows), -1, 0)

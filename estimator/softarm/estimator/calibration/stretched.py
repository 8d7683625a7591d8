"""Answers of a model whose pressures are worth more as their chambers are stretched."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.calibration.solver import LARGEST_MOVE, Response, Solver
from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp
from softarm.estimator.stretch import StretchLaw

Floats = NDArray[np.float64]

PASSES = 6


def respond(
    solver: Solver,
    scales: Mapping[str, float],
    law: StretchLaw | None,
    pressures: Floats,
    loads: Floats,
    gravity: Floats,
    memory: Response | None,
) -> Response:
    """Solve at many pressures on unstretched chambers and loads; see ``Solver.respond``.

    The pressures are made with the stretches of ``memory``, and what these have changed by since is made up
    for by one Newton step, as long as that is short.

    Args:
        solver: The model, which knows nothing of the stretch.
        scales: Stiffness factors.
        law: What stretching a chamber is worth; ``None`` for nothing.
        pressures: On unstretched chambers [Pa], shape (nodes, chambers).
        loads: Amplitudes of the model's loads, shape (nodes, loads).
        gravity: In the base frame [m/s2], shape (3,).
        memory: An earlier answer at the same nodes to start from.
    """
    if law is None or not law.gain:
        return solver.respond(scales, pressures, loads, gravity, memory)
    stretches = np.zeros_like(pressures)
    if memory is not None:
        stretches = np.where(memory.converged[:, None], law.stretches(memory.frames), 0.0)
    for _ in range(PASSES):
        answer = solver.respond(scales, law.worth(pressures, stretches), loads, gravity, memory)
        move, along = _following(law, pressures, stretches, answer)
        if np.abs(move[answer.converged]).max(initial=0.0) < LARGEST_MOVE:
            break
        memory = answer
        stretches = np.where(answer.converged[:, None], law.stretches(answer.frames), 0.0)
    twists = move.reshape(len(move), -1, 6)
    frames = Frames(answer.frames.positions + twists[..., :3], exp(twists[..., 3:]) @ answer.frames.rotations)
    return replace(
        answer,
        frames=frames,
        by_pressure=along @ (answer.by_pressure * (1.0 + law.gain * law.stretches(frames))[:, None, :]),
        by_load=along @ answer.by_load,
        by_gravity=along @ answer.by_gravity,
        by_factor=along @ answer.by_factor,
    )


def _following(
    law: StretchLaw, pressures: Floats, stretches: Floats, answer: Response
) -> tuple[Floats, Floats]:
    """Let the pressures follow the stretch.

    With C the twists per unit of pressure, E the rows of the stretches and G = g p, all motion m becomes
    A m, A = 1 + C G (1 - E C G)^-1 E, and the stretches' change q since they were taken moves by A C G q.

    Returns:
        That move of the section twists, shape (nodes, 6 sections), and A, shape (nodes, 6 sections, same).
    """
    rows = law.rows(answer.frames)
    pushed = answer.by_pressure * (law.gain * pressures)[:, None, :]
    kept = np.eye(pressures.shape[1]) - rows @ pushed
    along = np.eye(rows.shape[-1]) + pushed @ np.linalg.solve(kept, rows)
    behind = (law.stretches(answer.frames) - stretches)[..., None]
    move: Floats = (along @ (pushed @ behind))[..., 0]
    return move, along

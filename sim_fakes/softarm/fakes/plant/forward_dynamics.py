"""Motion of a chain in time that grows with its length, where MuJoCo factors a matrix of all joints.

The articulated-body algorithm (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 7), one joint
axis after another, in MuJoCo's frame of ``cdof`` and ``cinert``: axes of the world, centred at the tree's
centre of mass, rotations before translations.
"""

import mujoco
import numpy as np
from numba import njit


class ForwardDynamics:
    """Integrates a tree of bodies, viscous damping implicitly and all else explicitly.

    With M the inertia and D the damping of the joints, h the step and f all forces, (M + h D) dv / dt = f, as
    in MuJoCo's Euler integrator.

    Args:
        model: Without constraints, actuators and tendons, all its bodies in one tree.
        data: Its positions and velocities, ``qfrc_applied`` and ``xfrc_applied`` are read; changed in place.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        self._step = float(model.opt.timestep)
        self._bias, self._velocity, self._acceleration = data.qfrc_bias, data.qvel, data.qacc
        self._arrays = (
            model.body_parentid, model.body_dofadr, model.body_dofnum, model.dof_damping,
            data.cinert, data.cdof, data.subtree_com[1], data.xipos, data.xfrc_applied,
            data.qfrc_passive, data.qfrc_applied, data.qfrc_bias,
        )  # fmt: skip
        bodies, axes = model.nbody, model.nv
        self._work = np.zeros((bodies, 6, 6)), np.zeros((bodies, 6)), np.zeros((axes, 6)), np.zeros((axes, 2))
        self.update()

    def update(self) -> None:
        """Compute all that follows from positions and velocities."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_comVel(self._model, self._data)

    def step(self) -> None:
        """Integrate one step and update what follows from it."""
        mujoco.mj_passive(self._model, self._data)
        mujoco.mj_rne(self._model, self._data, 0, self._bias)
        _accelerations(*self._arrays, *self._work, self._step, self._acceleration)
        self._velocity += self._step * self._acceleration
        mujoco.mj_integratePos(self._model, self._data.qpos, self._velocity, self._step)
        self.update()


@njit(cache=True, nogil=True)
def _accelerations(  # type: ignore[no-untyped-def]
    parents, first_axes, axis_counts, damping, inertias, axes, centre, centres, loads, passive, applied, bias,
    articulated, needed, pulls, scalars, step, accelerations,
):  # fmt: skip
    """Solve for the accelerations.

    With A the articulated inertia of a body, s one of its axes, d the damping there and h the step, the axis
    reduces A by A s (s A s + h d)^-1 s A and passes the rest to the body above; likewise for the force that
    the axes below need.
    """
    articulated[:], needed[:] = 0.0, 0.0
    for b in range(len(parents) - 1, 0, -1):
        inertia, need, parent = articulated[b], needed[b], parents[b]
        _add_inertia(inertias[b], inertia)
        _subtract_load(centres[b] - centre, loads[b], need)
        for i in range(first_axes[b] + axis_counts[b] - 1, first_axes[b] - 1, -1):
            pivot, rest = step * damping[i], passive[i] + applied[i] - bias[i]
            for row in range(6):
                pull = 0.0
                for column in range(6):
                    pull += inertia[row, column] * axes[i, column]
                pulls[i, row] = pull
                pivot += pull * axes[i, row]
                rest -= need[row] * axes[i, row]
            for row in range(6):
                share = pulls[i, row] / pivot
                need[row] += share * rest
                for column in range(6):
                    inertia[row, column] -= share * pulls[i, column]
            scalars[i, 0], scalars[i, 1] = pivot, rest
        articulated[parent] += inertia
        needed[parent] += need
    moved = needed
    moved[0] = 0.0
    for b in range(1, len(parents)):
        moved[b] = moved[parents[b]]
        for i in range(first_axes[b], first_axes[b] + axis_counts[b]):
            rest = scalars[i, 1]
            for row in range(6):
                rest -= pulls[i, row] * moved[b, row]
            accelerations[i] = rest / scalars[i, 0]
            for row in range(6):
                moved[b, row] += accelerations[i] * axes[i, row]


@njit(cache=True, nogil=True)
def _add_inertia(inertia, out):  # type: ignore[no-untyped-def]
    """Add MuJoCo's ten numbers of a body to a spatial inertia: xx yy zz xy xz yz, mass times centre, mass."""
    x, y, z = inertia[6], inertia[7], inertia[8]
    for row in range(3):
        out[row, row] += inertia[row]
        out[row + 3, row + 3] += inertia[9]
    for row, column, value in (
        (0, 1, inertia[3]), (0, 2, inertia[4]), (1, 2, inertia[5]),
        (0, 4, -z), (0, 5, y), (1, 3, z), (1, 5, -x), (2, 3, -y), (2, 4, x),
    ):  # fmt: skip
        out[row, column] += value
        out[column, row] += value


@njit(cache=True, nogil=True)
def _subtract_load(arm, load, need):  # type: ignore[no-untyped-def]
    """Subtract a force and a torque at a body's centre of mass from what its subtree needs."""
    x, y, z = arm
    fx, fy, fz = load[0], load[1], load[2]
    need[0] -= load[3] + y * fz - z * fy
    need[1] -= load[4] + z * fx - x * fz
    need[2] -= load[5] + x * fy - y * fx
    need[3] -= fx
    need[4] -= fy
    need[5] -= fz

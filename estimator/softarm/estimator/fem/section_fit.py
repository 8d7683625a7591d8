"""The frames of all sections at once, from the few moments of a nodal field that they depend on."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.sections import SectionFrame
from softarm.estimator.fem.transport import Transport
from softarm.estimator.mesh import Floats
from softarm.estimator.model import Frames


@dataclass(frozen=True)
class Fitted:
    """Best-fit frames of all sections at a configuration, with the derivative of their twists.

    Args:
        frames: Their positions and rotations.
        turns: Rotations since rest, shape (sections, 3, 3).
        spins: Matrices R (tr U - U)^-1 of ``FramePose``, shape (sections, 3, 3).
        levers: From the mean of each section's points to its frame's origin [m], shape (sections, 3).
    """

    frames: Frames
    turns: Floats
    spins: Floats
    levers: Floats

    def twists(self, moments: Floats) -> Floats:
        """Give the stacked twists of displacements with the given moments.

        Args:
            moments: Shape (displacements, 4 sections, 3).

        Returns:
            Shape (displacements, 6 sections).
        """
        twists = np.empty((len(moments), 6 * len(self.turns)))
        section_twists(np.ascontiguousarray(moments), self.turns, self.spins, self.levers, twists)
        return twists


@dataclass(frozen=True)
class SectionFit:
    """What the frames of all sections depend on: linear functions of the nodes.

    The moments of a nodal field v at a section are its mean over the section's points and, column by column,
    M = sum_s v_s c_s^T with the arms c of ``SectionFrame``.

    Args:
        weights: Moments per nodal value, four rows for each section, shape (4 sections, nodes).
        of_divergence: Moments of ``Transport.assemble(A)`` per value of the divergence of A, likewise.
        offsets: Rest position of each frame's origin less the mean of its points [m], shape (sections, 3).
        rotations: Rest rotations of the frames, shape (sections, 3, 3).
        single: Whether a section is a single point, whose axes never turn, shape (sections,).
    """

    weights: Floats
    of_divergence: Floats
    offsets: Floats
    rotations: Floats
    single: np.ndarray[tuple[int], np.dtype[np.bool_]]

    def at(self, positions: Floats) -> Fitted:
        """Fit the frames to current nodes [m], shape (nodes, 3)."""
        count = len(self.offsets)
        moments = (self.weights @ positions).reshape(count, 4, 3)
        turns, spins = np.empty((count, 3, 3)), np.empty((count, 3, 3))
        fit_sections(moments, self.single, turns, spins)
        levers = (turns @ self.offsets[:, :, None])[:, :, 0]
        return Fitted(Frames(moments[:, 0] + levers, turns @ self.rotations), turns, spins, levers)


def build_section_fit(frames: tuple[SectionFrame, ...], nodes: int, transport: Transport) -> SectionFit:
    """Collect the moments of sections of a mesh with a number of nodes."""
    count = len(frames)
    weights = np.zeros((count, 4, nodes))
    for index, frame in enumerate(frames):
        points = frame.points.matrix(nodes)
        weights[index, 0] = points.mean(axis=0)
        weights[index, 1:] = frame.arms.T @ points
    flat = weights.reshape(4 * count, nodes)
    return SectionFit(
        weights=flat,
        of_divergence=transport.solve_poisson(flat),
        offsets=np.array([frame.origin - frame.mean for frame in frames]).reshape(count, 3),
        rotations=np.array([frame.rotation for frame in frames]).reshape(count, 3, 3),
        single=np.array([len(frame.arms) == 1 for frame in frames], dtype=np.bool_),
    )


@compiled
def fit_sections(
    moments: Floats,
    single: np.ndarray[tuple[int], np.dtype[np.bool_]],
    turns: Floats,
    spins: Floats,
) -> None:
    """Fill turns and spins from the moments at positions, shape (sections, 4, 3); see ``SectionFrame.at``."""
    for s in range(moments.shape[0]):
        if single[s]:
            turns[s], spins[s] = np.eye(3), np.zeros((3, 3))
            continue
        left, values, right = np.linalg.svd(np.ascontiguousarray(moments[s, 1:].T))
        if np.linalg.det(left) * np.linalg.det(right) < 0.0:
            left[:, 2] *= -1.0
            values[2] *= -1.0
        turns[s] = left @ right
        # (tr U - U)^-1 in the eigenbasis of U, whose eigenvalues are the (signed) singular values.
        spins[s] = left @ (right / (values.sum() - values).reshape(3, 1))


@compiled
def section_twists(moments: Floats, turns: Floats, spins: Floats, levers: Floats, twists: Floats) -> None:
    """Fill the twists of fields with moments of shape (fields, 4 sections, 3); see ``FramePose.push``."""
    turned, axial = np.empty((3, 3)), np.empty(3)
    for f in range(moments.shape[0]):
        for s in range(turns.shape[0]):
            for j in range(3):
                for i in range(3):
                    turned[j, i] = 0.0
                    for k in range(3):
                        turned[j, i] += moments[f, 4 * s + 1 + j, k] * turns[s, k, i]
            for i in range(3):
                axial[i] = turned[(i + 1) % 3, (i + 2) % 3] - turned[(i + 2) % 3, (i + 1) % 3]
            out = twists[f, 6 * s : 6 * s + 6]
            for i in range(3):
                out[3 + i] = 0.0
                for k in range(3):
                    out[3 + i] += spins[s, i, k] * axial[k]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                out[i] = moments[f, 4 * s, i] + out[3 + j] * levers[s, k] - out[3 + k] * levers[s, j]

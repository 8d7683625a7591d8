"""The interface of an arm model for the inverse problem, the sensors and the diagnosis.

A model maps inputs (chamber pressures and load amplitudes) to the frames of the rigid sections. The
finite-element model and the calibrated rod both answer to the protocols below, so that whatever is
written against them runs on either.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

from softarm.estimator.arrays import Floats


@dataclass(frozen=True)
class Frames:
    """Frames of the rigid sections in the base frame.

    Args:
        positions: Origins [m], shape (sections, 3).
        rotations: Rotation matrices, columns are the section's axes, shape (sections, 3, 3).
    """

    positions: Floats
    rotations: Floats


@dataclass(frozen=True)
class Load:
    """A generalised point load of unknown or given amplitude, fixed in direction in the base frame.

    Args:
        name: What reports call it, such as ``tip_x``.
        kind: ``force`` [N] or ``moment`` [N m].
        direction: Unit vector in the base frame, shape (3,).
        section: Rigid section it acts on; ``None`` when it acts at a height along the arm.
        height: Rest distance from the base along z [m], used when ``section`` is ``None``.
    """

    name: str
    kind: Literal["force", "moment"]
    direction: tuple[float, float, float]
    section: str | None = None
    height: float | None = None


AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def loads_along(
    name: str,
    axes: str,
    kind: Literal["force", "moment"] = "force",
    *,
    section: str | None = None,
    height: float | None = None,
) -> tuple[Load, ...]:
    """Make one load along each of some axes of the base frame, named ``<name>_<axis>``.

    Args:
        name: Beginning of their names.
        axes: Letters of the axes, such as ``"xy"``.
        kind: Whether they are forces [N] or moments [N m].
        section: Section that they act on; see ``Load``.
        height: Height at which they act, where that is no section [m]; see ``Load``.
    """
    return tuple(Load(f"{name}_{axis}", kind, AXES[axis], section, height) for axis in axes)


@dataclass(frozen=True)
class Inputs:
    """What drives the arm.

    Args:
        pressures: Gauge pressures of the chambers [Pa], shape (chambers,).
        loads: Amplitudes of the model's loads [N or N m], shape (loads,).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
    """

    pressures: Floats
    loads: Floats
    gravity: Floats


class Linearisation(Protocol):
    """The model linearised about an iterate, which need not be in equilibrium."""

    @property
    def frames(self) -> Frames:
        """Frames of the sections at the iterate."""

    @property
    def residual_norm(self) -> float:
        """Norm of the out-of-balance force over that of the applied forces; 0 for an explicit model."""

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows.

        A twist of a section is its translation [m] and its rotation vector [rad], both in the base frame:
        p' = p + v, R' = exp(w) R. The twists of all sections are stacked, six per section.

        Args:
            rows: Sensitivities of some outputs to the stacked twists, shape (outputs, 6 sections).

        Returns:
            The outputs' change through the Newton step towards equilibrium at unchanged inputs, shape
            (outputs,), and their change per unit of each pressure, then each load, shape (outputs, inputs).
        """


class ArmDescription(Protocol):
    """What every model states of its arm."""

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose frames it predicts."""

    @property
    def chambers(self) -> int:
        """Number of chambers."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""


State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


class ArmModel(ArmDescription, Protocol[State, Step]):
    """A static model of the arm, immutable; its state is a value that the caller keeps."""

    def rest(self) -> State:
        """Return the unloaded state."""

    def refreshed(self, state: State) -> State:
        """Return a state without what earlier linearisations left in it to be used again."""

    def linearise(self, state: State, inputs: Inputs) -> Step:
        """Linearise about a state under given inputs."""

    def advance(self, step: Step, change: Floats) -> State:
        """Take the Newton step for inputs changed by ``change`` (pressures, then loads)."""

    def solve(self, inputs: Inputs, start: State) -> tuple[State, bool]:
        """Find the equilibrium under fixed inputs; the flag is true when it converged."""

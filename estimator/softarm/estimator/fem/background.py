"""Factoring the tangent in a thread while the caller goes on with the last factor."""

from softarm.estimator.background import Background
from softarm.estimator.fem.model import FiniteElementModel
from softarm.estimator.fem.stiffness import Stiffness, take_stiffness
from softarm.estimator.mesh import Floats
from softarm.estimator.model import Inputs


class Refactoriser(Background[tuple[Floats, Inputs], Stiffness | None]):
    """Factors the latest configuration offered next; the kernels run without the interpreter's lock.

    Args:
        model: Model whose tangent is factored.
    """

    def __init__(self, model: FiniteElementModel) -> None:
        super().__init__(self._take, "refactoriser")
        self._model = model

    @property
    def latest(self) -> Stiffness | None:
        """The newest factor, None before the first is done."""
        return self.newest

    def offer(self, displacement: Floats, inputs: Inputs) -> None:
        """Ask for the factor at a configuration, in place of what was asked and not yet begun.

        Raises:
            RuntimeError: An earlier factorisation failed unexpectedly; the cause is attached.
        """
        self.ask((displacement, inputs))

    def _take(self, configuration: tuple[Floats, Inputs]) -> Stiffness | None:
        """Factor; where the tangent has no factor the last one stays."""
        return take_stiffness(self._model, *configuration) or self.newest

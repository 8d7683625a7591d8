"""Factoring the tangent in a thread while the caller goes on with the last factor."""

from softarm.estimator.arrays import Floats
from softarm.estimator.background import Background
from softarm.estimator.fem.model import FiniteElementModel
from softarm.estimator.fem.tracking.frozen_tangent import FrozenTangent, freeze_tangent
from softarm.estimator.model import Inputs


class BackgroundFactorisation(Background[tuple[Floats, Inputs], FrozenTangent | None]):
    """Factors the latest configuration offered next; the kernels run without the interpreter's lock.

    Args:
        model: Model whose tangent is factored.
        single: As for ``freeze_tangent``.
    """

    def __init__(self, model: FiniteElementModel, *, single: bool = True) -> None:
        super().__init__(self._freeze, "factorisation")
        self._model, self._single = model, single

    @property
    def latest(self) -> FrozenTangent | None:
        """The newest factor, None before the first is done."""
        return self.newest

    def offer(self, displacement: Floats, inputs: Inputs) -> None:
        """Request the factor at a configuration, in place of a request that has not yet begun.

        Raises:
            RuntimeError: An earlier factorisation failed unexpectedly; the cause is attached.
        """
        self.ask((displacement, inputs))

    def _freeze(self, configuration: tuple[Floats, Inputs]) -> FrozenTangent | None:
        """Factor; where the tangent has no factor the last one stays."""
        return freeze_tangent(self._model, *configuration, single=self._single) or self.newest

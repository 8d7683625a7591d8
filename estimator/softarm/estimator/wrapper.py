"""Members that models which wrap another one pass on from it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

from softarm.estimator.model import ArmDescription, Load
from softarm.estimator.response import BatchArmModel


@dataclass(frozen=True)
class ModelWrapper:
    """A model of the same arm as another one."""

    model: ArmDescription

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose frames the wrapped model predicts."""
        return self.model.sections

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return self.model.chambers

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return self.model.loads


@dataclass(frozen=True)
class BatchModelWrapper(ModelWrapper):
    """A model that solves many samples by another one that does."""

    model: BatchArmModel

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions whose stiffness can be scaled."""
        return self.model.regions

    @property
    def takes_eigenstrains(self) -> bool:
        """Whether the regions can strain freely."""
        return self.model.takes_eigenstrains

    def with_scales(self, scales: Mapping[str, float]) -> Self:
        """Return a copy with other stiffness factors of some regions."""
        return replace(self, model=self.model.with_scales(scales))

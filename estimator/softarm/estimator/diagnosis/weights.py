"""How far residuals scatter where nothing that the library knows is missing, and how long they stay alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.statistics import correlation_length


@dataclass(frozen=True)
class Weights:
    """The noise model of a diagnosis.

    Args:
        scale: Standard deviation of each channel's residual: noise, and what the fullest model leaves.
        effective_sample_fraction: Share of the samples that are worth an independent one.
    """

    scale: Mapping[str, float]
    effective_sample_fraction: float

    def stds(self, names: Sequence[str]) -> Floats:
        """Return the standard deviation of each of some channels, shape (channels,)."""
        return np.array([self.scale[name] for name in names])

    def bounded(self, reference: "Weights", factor: float) -> "Weights":
        """Keep within a factor of the noise of recordings in which nothing is missing."""
        scale = {
            name: min(value, factor * reference.scale[name]) if name in reference.scale else value
            for name, value in self.scale.items()
        }
        return Weights(
            scale, max(self.effective_sample_fraction, reference.effective_sample_fraction / factor)
        )


def weights_of(
    names: Sequence[Sequence[str]],
    residuals: Sequence[Floats],
    sigmas: Sequence[Floats],
) -> Weights:
    """Learn the noise model from residuals of the fullest model.

    Args:
        names: Channels of each session.
        residuals: Residuals of each session, shape (samples, rows).
        sigmas: Standard deviation of each row's noise, shape (rows,).
    """
    squares: dict[str, list[Floats]] = {}
    floors: dict[str, float] = {}
    lengths: list[float] = []
    for own, residual, sigma in zip(names, residuals, sigmas, strict=True):
        for index, name in enumerate(own):
            column = residual[:, index]
            floors[name] = max(floors.get(name, 0.0), float(sigma[index]))
            seen = column[np.isfinite(column)]
            if len(seen):
                squares.setdefault(name, []).append(seen**2)
                lengths.append(correlation_length(column))
    rms = {name: float(np.sqrt(np.mean(np.concatenate(parts)))) for name, parts in squares.items()}
    scale = {name: max(rms.get(name, 0.0), floor) for name, floor in floors.items()}
    return Weights(scale, 1.0 / max(float(np.mean(lengths)) if lengths else 1.0, 1.0))

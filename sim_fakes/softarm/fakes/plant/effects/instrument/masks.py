"""Which entries of a signal a place means."""

import numpy as np
from numpy.typing import NDArray

from softarm.fakes.plant.effects.effect import Where

CHAMBERS = 16


def chamber_mask(where: Where) -> NDArray[np.bool_]:
    """Select the chamber that is given, or all of them, among as many as a valve bank can have."""
    mask = np.ones(CHAMBERS, dtype=bool)
    if "chamber" in where:
        mask[:] = False
        mask[int(where["chamber"])] = True
    return mask

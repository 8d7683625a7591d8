"""How the pressures on the model's unstretched chambers change with the unknowns of a calibration."""

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.calibration.parameters import Parameter, Setting
from softarm.estimator.model import Frames
from softarm.estimator.stretch import StretchLaw

Floats = NDArray[np.float64]


def by_unknown(parameter: Parameter, setting: Setting, frames: Frames, measured: Floats) -> Floats:
    """Differentiate the pressures by an unknown [Pa per its unit], shape (nodes, chambers).

    Args:
        parameter: The unknown, one that changes a pressure.
        setting: Values of all unknowns.
        frames: Frames of the sections there, arrays with a leading axis (nodes,).
        measured: Recorded pressures [Pa], shape (nodes, chambers).
    """
    actuation, change = setting.actuation, np.zeros_like(measured)
    if parameter.kind == "stretch":
        assert setting.stretch is not None  # else it is no unknown
        return by_worth(setting.stretch, frames, actuation.to_chamber(measured))
    if parameter.kind == "crosstalk":
        row, source = parameter.place
        change[:, row] = measured[:, source]
        return change
    growth = actuation.curve + actuation.bow * measured
    whole = {
        "gain": measured * (1.0 + growth * measured),
        "bias": np.ones_like(measured),
        "curve": actuation.gain * measured**2,
        "bow": actuation.gain * measured**3,
    }[parameter.kind]
    change[:, parameter.place] = whole[:, parameter.place]
    return change


def by_worth(law: StretchLaw, frames: Frames, pressures: Floats) -> Floats:
    """Give the change of the pressures on unstretched chambers that a change of the gain is like [Pa].

    Args:
        law: What stretching a chamber is worth.
        frames: Frames of the sections, arrays with a leading axis (nodes,).
        pressures: On unstretched chambers [Pa], shape (nodes, chambers).
    """
    stretches = law.stretches(frames)
    return np.asarray(pressures * stretches / (1.0 + law.gain * stretches))

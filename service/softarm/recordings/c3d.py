"""Markers of ``.c3d`` files, as Qualisys and other motion-capture programs export them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import MARKER_SUFFIXES
from softarm.recordings.columns import TIME
from softarm.recordings.mapping import mapped_names

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def read_c3d(path: Path, info: Mapping[str, Any]) -> dict[str, Floats]:
    """Read the labelled points of a file, in metres; a lost point is NaN.

    Args:
        path: The file.
        info: Its column map, table ``markers``.

    Raises:
        InputError: It is no C3D file, has no labelled points, or an unknown unit of length.
    """
    import ezc3d  # a heavy library that only these files need

    try:
        data = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(str(path), f"cannot be read as C3D ({reason})", "export it again") from None
    point = data["parameters"]["POINT"]
    labels = [str(label) for label in point["LABELS"]["value"]]
    if not labels:
        raise InputError(
            f"{path}, POINT:LABELS", "names no marker", "label the trajectories before the export"
        )
    unit = str((point["UNITS"]["value"] or ["mm"])[0]).strip().lower()
    if unit not in METRES:
        raise InputError(f"{path}, POINT:UNITS", f"is {unit}", "export in mm or m")
    rate = float(point["RATE"]["value"][0])
    if rate <= 0:
        raise InputError(f"{path}, POINT:RATE", f"is {rate}", "export with the rate of the cameras")
    points = np.asarray(data["data"]["points"][:3], dtype=np.float64) * METRES[unit]
    lost = (np.asarray(data["data"]["meta_points"]["residuals"])[0] < 0) | (points == 0).all(axis=0)
    points[:, lost] = np.nan
    columns = {TIME: np.arange(points.shape[2]) / rate}
    for number, name in enumerate(mapped_names(str(path), labels, info, "markers")):
        if name is not None:
            columns |= {
                f"marker_{name}_{suffix}": points[i, number].copy()
                for i, suffix in enumerate(MARKER_SUFFIXES)
            }
    return columns

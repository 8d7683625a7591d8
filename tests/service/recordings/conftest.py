import os
from pathlib import Path

import numpy as np
import pytest

from softarm.estimator.recording import Recording


@pytest.fixture
def development_recordings() -> Path:
    beside = Path(__file__).parents[4] / "shared" / "recordings"
    folder = Path(os.environ.get("SOFTARM_RECORDINGS", beside))
    if not folder.is_dir():
        pytest.skip(f"the development recordings are not at {folder}")
    return folder


@pytest.fixture
def small() -> Recording:
    time = np.arange(6) * 0.01
    sine = np.sin(time)
    pose = {f"frame_tip_{axis}_m": 0.1 * sine + i for i, axis in enumerate("xyz")}
    pose |= {
        "frame_tip_qw": np.cos(sine),
        "frame_tip_qx": np.sin(sine),
        "frame_tip_qy": 0 * sine,
        "frame_tip_qz": 0 * sine,
    }
    columns = {
        "pressure_cmd_0_pa": np.full(6, 30e3),
        "pressure_0_pa": 30e3 + 100 * sine,
        **pose,
        "bend_tip_x_rad": sine,
        "bend_tip_y_rad": np.array([0.1, np.nan, 0.3, np.nan, np.nan, 0.5]),
        "marker_tip1_x_m": sine,
        "marker_tip1_y_m": np.array([np.nan] * 6),
        "marker_tip1_z_m": sine,
        "gauge_hook_n": sine,
        "estimate_force_tip_x_n": sine,
    }
    return Recording("small", time, columns, {"specimen": "sopra", "rate_hz": 100.0})

"""Make the example recordings.

``sopra_pull``: the model's own arm under two pressures, pulled at its tip, with noise.
``valve_low``: a valve without an arm that regulates 3 kPa below its set-point.

Run from the root of the repository: .venv/bin/python examples/recordings/make.py
"""

from pathlib import Path

import numpy as np

from softarm.estimator.arm import build_arm
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import Registration
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import load_specimen
from softarm.recordings import save_recording

FOLDER = Path(__file__).parent
RATE = 20.0  # Hz
PULL = 0.3  # N along x at the tip, between 1.5 and 3 s
VALVE_STEP = 0.05  # s
VALVE_LAG = 0.1  # s
VALVE_ERROR = 3e3  # Pa


def pulled_arm() -> Recording:
    """Solve the model at every sample."""
    specimen = load_specimen("sopra")
    model = build_arm(specimen)
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    pressures = np.zeros((len(time), model.chambers))
    pressures[:, 0] = 15e3 * np.clip(time, 0, 1)
    pressures[:, 4] = 12e3 * np.clip(time - 0.3, 0, 1)
    loads = np.zeros((len(time), len(model.loads)))
    tip_x = [load.name for load in model.loads].index("tip_x")
    loads[:, tip_x] = PULL * np.clip(4 * (time - 1.5), 0, 1) * (time < 3.0)
    state, frames = model.rest(), []
    for acting, load in zip(pressures, loads, strict=True):
        state, found = model.solve(Inputs(acting, load, np.array(specimen.gravity_m_s2)), state)
        assert found
        frames.append(model.section_frames(state))
    moved = Frames(np.array([f.positions for f in frames]), np.array([f.rotations for f in frames]))
    rng = np.random.default_rng(0)
    columns = {
        f"pressure_{k}_pa": np.round(pressures[:, k] + rng.normal(0, 100, len(time)), 1)
        for k in range(model.chambers)
    }
    make = SpecimenSensors(specimen, model.sections, Registration())
    for section in ("intermediate", "tip"):
        angles = make.bend(section).predict(moved) + rng.normal(0, specimen.noise.bend_rad, (len(time), 2))
        columns |= {f"bend_{section}_{axis}_rad": np.round(angles[:, i], 6) for i, axis in enumerate("xy")}
    info = {
        "specimen": "sopra",
        "rate_hz": RATE,
        "pressure_source": "measured",
        "source": "examples/recordings/make.py, the project's own finite-element model",
        "notes": f"Chambers 0 and 4 are filled, then the tip is pulled along x by {PULL} N from 1.5 to 3 s.",
    }
    return Recording("sopra_pull", time, columns, info)


def low_valve() -> Recording:
    """Follow random set-points with a first-order lag and a constant error."""
    rng = np.random.default_rng(3)
    commanded = np.repeat(np.round(rng.uniform(10e3, 60e3, 30), -2), 80)
    commanded[:40] = 0.0
    pressure = np.zeros(len(commanded))
    for k in range(1, len(commanded)):
        target = max(commanded[k - 1] - VALVE_ERROR, 0.0)
        pressure[k] = pressure[k - 1] + (target - pressure[k - 1]) * VALVE_STEP / VALVE_LAG
    columns = {
        "pressure_cmd_0_pa": commanded,
        "pressure_0_pa": np.round(pressure + rng.normal(0.0, 60.0, len(pressure)), 1),
    }
    info = {
        "specimen": "sopra",
        "rate_hz": 1.0 / VALVE_STEP,
        "pressure_source": "measured",
        "source": "examples/recordings/make.py, a simulated valve without an arm",
        "notes": f"While it is open, the valve stays {VALVE_ERROR:g} Pa below its set-point.",
    }
    time = np.round(VALVE_STEP * np.arange(len(pressure)), 3)
    return Recording("valve_low", time, columns, info)


def main() -> None:
    """Write the recordings."""
    for recording in (pulled_arm(), low_valve()):
        save_recording(recording, FOLDER / recording.name, force=True)


if __name__ == "__main__":
    main()

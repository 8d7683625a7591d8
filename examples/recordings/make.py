"""Make ``sopra_pull``: the model's own arm under two pressures, pulled at its tip, with noise.

Run from the root of the repository: .venv/bin/python examples/recordings/make.py
"""

from pathlib import Path

import numpy as np

from softarm.estimator.arm import build_arm
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import Registration, Scene
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import load_specimen
from softarm.recordings import save_recording

FOLDER = Path(__file__).parent / "sopra_pull"
RATE = 20.0  # Hz
PULL = 0.3  # N along x at the tip, between 1.5 and 3 s


def main() -> None:
    """Solve the model at every sample and write the recording."""
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
    scene = Scene(
        Frames(np.array([f.positions for f in frames]), np.array([f.rotations for f in frames])), loads
    )
    rng = np.random.default_rng(0)
    columns = {
        f"pressure_{k}_pa": np.round(pressures[:, k] + rng.normal(0, 100, len(time)), 1)
        for k in range(model.chambers)
    }
    make = SpecimenSensors(specimen, model.sections, Registration())
    for section in ("intermediate", "tip"):
        angles = make.bend(section).predict(scene) + rng.normal(0, specimen.noise.bend_rad, (len(time), 2))
        columns |= {f"bend_{section}_{axis}_rad": np.round(angles[:, i], 6) for i, axis in enumerate("xy")}
    info = {
        "specimen": "sopra",
        "rate_hz": RATE,
        "pressure_source": "measured",
        "source": "examples/recordings/make.py, the project's own finite-element model",
        "notes": f"Chambers 0 and 4 are filled, then the tip is pulled along x by {PULL} N from 1.5 to 3 s.",
    }
    save_recording(Recording("sopra_pull", time, columns, info), FOLDER, force=True)


if __name__ == "__main__":
    main()

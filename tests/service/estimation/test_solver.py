import numpy as np

from softarm.common.rods import trusted_rod
from softarm.common.shipped import fake_specimen
from softarm.daemon.config import ControlSettings, SensorSettings
from softarm.daemon.estimation.messages import EstimationRequest
from softarm.daemon.estimation.solver import Solver, SolverSettings
from softarm.estimator.dynamics.force_filter import ForceFilter
from softarm.estimator.model import Inputs
from softarm.estimator.specimen import load_specimen
from softarm.estimator.stretch import stretched

PRESSURE_PA, FORCE_N = 30e3, 0.6


def solver_of(specimen):
    """Build the solver of an arm with an orientation of each section and a force on its tip."""
    sensors = tuple(
        SensorSettings(kind="orientation", section=name, device="qtm", channel=name, needed=True)
        for name in ("intermediate", "tip")
    )
    return Solver(SolverSettings(specimen, sensors, ControlSettings(model="fem", forces_on=("tip",))))


def test_a_solver_that_was_built_has_filtered_forces_before_the_first_request(monkeypatch):
    """What is compiled only then may take longer than a request may, where nothing has been compiled."""
    advanced = []
    followed = ForceFilter.at

    def at(self, arm, seconds):
        advanced.append(seconds)
        return followed(self, arm, seconds)

    monkeypatch.setattr(ForceFilter, "at", at)
    solver_of(load_specimen(fake_specimen())).close()
    assert advanced


def test_the_rod_answers_for_an_arm_that_was_lost_in_a_jump_until_the_finite_elements_have_caught_up():
    """Searches on the finite elements alone fail for seconds there, and so does a hold."""
    specimen = load_specimen(fake_specimen())
    solver = solver_of(specimen)
    try:
        loads = [load for load in trusted_rod(specimen).loads if load.section == "tip"][:2]
        rod, gravity = stretched(trusted_rod(specimen).with_loads(loads), specimen), np.array([0, 0, 9.81])
        rng = np.random.default_rng(3)
        for jump in range(4):
            inputs = Inputs(rng.uniform(0, PRESSURE_PA, 6), rng.uniform(-FORCE_N, FORCE_N, 2), gravity)
            state, found = rod.solve(inputs, rod.rest())
            assert found
            readings = solver._suite.predict(rod.linearise(state, inputs).frames)
            models = []
            for instant in range(5):
                request = EstimationRequest(
                    jump + 0.15 * instant, 0, readings, inputs.pressures, gravity,
                    ("orientation_intermediate", "orientation_tip"),
                )  # fmt: skip
                result = solver(request)
                assert result.converged
                models.append(result.model)
                solver._background_solver.wait()
            assert models[0] == "rod"
            assert models[-1] == "fem"
    finally:
        solver.close()

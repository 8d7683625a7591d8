import mujoco
import numpy as np
import pytest

from softarm.fakes.plant.chain import build
from softarm.fakes.plant.effects import Concealed, apply
from softarm.fakes.plant.forward_dynamics import ForwardDynamics
from softarm.fakes.plant.parameters import ArmParameters


@pytest.mark.parametrize("effects", [(), (Concealed("tip_payload"), Concealed("base_compliance"))])
def test_a_step_is_that_of_the_implicit_damping_of_mujoco(
    small: ArmParameters, effects: tuple[Concealed, ...]
) -> None:
    model = build(apply(small, effects)).model
    rng, data = np.random.default_rng(3), mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, 0.02 * rng.normal(size=model.nv), 1.0)
    data.qvel[:] = 0.1 * rng.normal(size=model.nv)
    data.qfrc_applied[:] = rng.normal(size=model.nv)
    data.xfrc_applied[1:] = rng.normal(size=(model.nbody - 1, 6))
    expected = mujoco.MjData(model)
    mujoco.mj_copyData(expected, model, data)
    mujoco.mj_step(model, expected)
    dynamics = ForwardDynamics(model, data)
    dynamics.step()
    np.testing.assert_allclose(data.qvel, expected.qvel, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(data.qpos, expected.qpos, rtol=1e-9, atol=1e-12)
    mujoco.mj_forward(model, expected)
    np.testing.assert_allclose(data.site_xpos, expected.site_xpos, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(data.cvel, expected.cvel, rtol=1e-9, atol=1e-9)

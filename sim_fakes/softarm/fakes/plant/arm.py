"""The fake arm: dynamics of a chain of rigid bodies with rubber, pressures and loads of its own."""

import math
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.fakes.plant.chain import PlantChain, build
from softarm.fakes.plant.effects import Concealed, apply
from softarm.fakes.plant.forward_dynamics import ForwardDynamics
from softarm.fakes.plant.loads import TautLine, contact, grasp, strength
from softarm.fakes.plant.material import FibreMemory, fresh_memory, joint_forces, tabulate
from softarm.fakes.plant.parameters import ArmParameters, sopra
from softarm.fakes.plant.pneumatics import effective_pressure, lines
from softarm.fakes.plant.random_law import RandomLaw
from softarm.fakes.plant.rotations import product, rotation_matrix, tilt
from softarm.fakes.plant.state import Cord, PlantInputs, PlantState

SETTLING_TIME = 2.0
SETTLING_DAMPING = 6.0
FORCE_LIMIT = 500.0
OBJECT = mujoco.mjtObj.mjOBJ_SITE


class FakeArm:
    """A dynamic soft arm; answers to ``Plant``.

    Args:
        parameters: Of the arm without concealed effects; SoPrA when left out.
        effects: What is concealed in it.
        start: Time at which it hangs at rest, vented [s]; it has warmed since time 0.
    """

    def __init__(
        self, parameters: ArmParameters | None = None, effects: tuple[Concealed, ...] = (), start: float = 0.0
    ) -> None:
        self._plain = parameters or sopra()
        self._effects = {effect.name: effect for effect in effects}
        self._start = start
        self._steps = 0
        self._pressures = np.zeros(self._plain.chambers)
        self._cord: Cord | None = None
        self._hook, self._hook_velocity = np.zeros(3), np.zeros(3)
        self._install()
        self._settle()
        self._inputs = PlantInputs(np.zeros(self.chambers))
        self._state: PlantState | None = None

    @property
    def parameters(self) -> ArmParameters:
        """The arm with its concealed effects."""
        return self._parameters

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the rigid sections, from the base to the tip."""
        return self._plain.sections

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the soft segments."""
        return tuple(segment.name for segment in self._plain.segments)

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return self._plain.chambers

    @property
    def state(self) -> PlantState:
        """The snapshot at the end of the last step; it is made on request."""
        if self._state is None:
            self._state = self._snapshot(self._inputs)
        return self._state

    @property
    def energy(self) -> float:
        """Kinetic energy [J]."""
        mujoco.mj_fwdPosition(self._chain.model, self._data)
        mujoco.mj_energyVel(self._chain.model, self._data)
        return float(self._data.energy[1])

    def advance(self, time: float, inputs: PlantInputs) -> None:
        """Step to the last whole step before ``time`` [s] under constant inputs.

        The hook of a cord that stays tied moves evenly from its last position to the new one.

        Args:
            time: Not earlier than the last step.
            inputs: What drives the arm meanwhile.

        Raises:
            InputError: The time lies before the last step, the number of pressures is wrong, or an effect is
                so strong that the simulation diverged.
        """
        steps = int(np.floor((time - self._start) / self._parameters.step + 1e-6))
        if steps < self._steps:
            raise InputError("time", f"{time} s is before {self._time} s", "give times that do not fall")
        if np.shape(inputs.valve_pressures) != (self.chambers,):
            raise InputError(
                "valve_pressures", f"shape {np.shape(inputs.valve_pressures)}", f"give {self.chambers} values"
            )
        if steps > self._steps:
            self._draw(inputs.cord, (steps - self._steps) * self._parameters.step)
            while self._steps < steps:
                self._step(inputs)
            self._inputs, self._state = inputs, None

    def switch(self, effect: str, value: object) -> None:
        """Set one concealed effect at run time.

        Args:
            effect: Its name.
            value: ``None`` or 0 for off; a number for its strength at its usual place; or a table of
                ``where`` and parameters.

        Raises:
            InputError: The arm has no such effect, or the value does not fit it.
        """
        chosen = _concealed(effect, value)
        effects = {name: known for name, known in self._effects.items() if name != effect}
        if chosen is not None:
            effects[effect] = chosen
        build(apply(self._plain, tuple(effects.values())))
        self._effects = effects
        self._state = self.state  # of the arm as it was
        old = self._chain, self._data, self._memory
        self._install()
        self._take_over(*old)

    def _draw(self, cord: Cord | None, seconds: float) -> None:
        """Set the hook on its way: a stage does not jump, and a taut cord would shake the arm if it did."""
        if cord is not None:
            goal, tied = self._to_base(np.array(cord.hook)), self._cord
            if tied is None or (tied.section, tied.length) != (cord.section, cord.length):
                self._hook = goal
            self._hook_velocity = (goal - self._hook) / seconds
        self._cord = cord

    def _install(self) -> None:
        """Build everything that follows from the parameters."""
        self._parameters = apply(self._plain, tuple(self._effects.values()))
        self._chain = build(self._parameters)
        self._data = mujoco.MjData(self._chain.model)
        self._table = tabulate(self._parameters, self._chain.joints)
        self._memory = fresh_memory(self._table)
        self._lines = lines(self._parameters.actuation, self._parameters.step)
        self._muscles = effective_pressure(self._parameters)
        actuation = self._parameters.actuation
        strength, law = actuation.random_law
        self._law = RandomLaw.draw(strength, law, self._plain.groups) if strength else None
        self._area_law = np.array([*actuation.narrowing, actuation.twist])
        self._mount = np.array(self._parameters.mount.quaternion)
        self._into_base = rotation_matrix(np.array(self._parameters.mount.quaternion)).T
        self._origin = np.array(self._parameters.mount.position)
        self._places = np.array([joint.segment for joint in self._chain.joints])
        self._chambers_at = _numbered(self._plain.groups)[self._places]
        self._frames = np.array([frame.quaternion for frame in self._plain.frames])
        self._elastic = np.hstack([self._chain.slides, self._chain.balls])
        self._section_forces = np.zeros((len(self.sections), 3))
        self._damping = self._chain.model.dof_damping.copy()
        self._dynamics = ForwardDynamics(self._chain.model, self._data)

    def _take_over(self, chain: PlantChain, data: mujoco.MjData, memory: FibreMemory) -> None:
        """Continue from the motion and the memory of the arm before a switch."""
        new_chain = self._chain
        self._data.qpos[new_chain.slide_positions] = data.qpos[chain.slide_positions]
        self._data.qpos[new_chain.ball_positions] = data.qpos[chain.ball_positions]
        self._data.qvel[new_chain.slides] = data.qvel[chain.slides]
        self._data.qvel[new_chain.balls] = data.qvel[chain.balls]
        self._memory.last[:] = memory.last
        self._memory.largest[:] = memory.largest
        self._memory.relaxed[:] = memory.last[:, :, None]
        for new, old in ((self._memory.relaxed, memory.relaxed), (self._memory.slipped, memory.slipped)):
            shared = min(new.shape[2], old.shape[2])
            new[:, :, :shared] = old[:, :, :shared]
        self._dynamics.update()

    def _settle(self) -> None:
        """Come to rest under gravity, with nothing remembered of the way."""
        inputs = PlantInputs(np.zeros(self.chambers))
        for _ in range(int(SETTLING_TIME / self._parameters.step)):
            self._step(inputs, settling=True)
        self._chain.model.dof_damping[:] = self._damping
        self._data.qvel[:] = 0.0
        self._steps = 0
        self._dynamics.update()

    @property
    def _time(self) -> float:
        """Time of the last step [s]."""
        return self._start + self._steps * self._parameters.step

    def _step(self, inputs: PlantInputs, settling: bool = False) -> None:
        """Integrate one internal step; kinematics are up to date before and after it."""
        self._pressures = self._lines.step(self._pressures, inputs.valve_pressures)
        effective = self._muscles.effective(self._pressures)
        slides = self._data.qpos[self._chain.slide_positions]
        quaternions = self._data.qpos[self._chain.ball_positions]
        if self._law is not None:
            effective = effective + self._law.push(
                self._pressures, self._bends(quaternions), self._parameters.step
            )
        forces = joint_forces(
            self._table, self._memory, (slides, quaternions),
            np.append(effective, 0.0)[self._chambers_at],
            self._area_law, self._modulus_factor(), settling,
        )  # fmt: skip
        if not np.abs(forces).max() < FORCE_LIMIT:
            raise InputError("fake arm", f"diverged at {self._time:.3f} s", "weaken its effects or loads")
        self._data.qfrc_applied[self._elastic] = forces
        self._damp(settling)
        self._apply_loads(inputs)
        self._hook = self._hook + self._parameters.step * self._hook_velocity
        self._dynamics.step()
        self._steps += 1

    def _bends(self, quaternions: Floats) -> Floats:
        """Add up the small rotations of each segment's joints about x and y [rad], shape (segments, 2)."""
        vectors = 2.0 * quaternions[:, 1:3]
        return np.stack([vectors[self._places == k].sum(axis=0) for k in range(len(self.segments))])

    def _damp(self, settling: bool) -> None:
        """Set the viscosity, which may depend on the speed of the tip."""
        if settling:
            self._chain.model.dof_damping[:] = SETTLING_DAMPING * self._damping
        elif self._parameters.damping_rise > 0.0:
            velocity = self._velocity(-1)
            slow = np.exp(-math.sqrt(velocity.dot(velocity)) / self._parameters.damping_speed)
            self._chain.model.dof_damping[:] = (1.0 + self._parameters.damping_rise * slow) * self._damping

    def _modulus_factor(self) -> float:
        """Return the scale of all moduli at this temperature."""
        warming = self._parameters.warming
        return 1.0 - warming.change * float(np.expm1(-self._time / warming.time))

    def _apply_loads(self, inputs: PlantInputs) -> None:
        """Put every load on its body, and keep the sums per section in the base frame."""
        data, loads = self._data, self._parameters.loads
        data.xfrc_applied[:] = 0.0
        self._section_forces[:] = 0.0
        self._tension = 0.0
        if inputs.cord is not None:
            index = self._section(inputs.cord.section)
            parameters = self._parameters
            line = TautLine(inputs.cord.length, parameters.cord_stiffness, parameters.cord_damping)
            force, self._tension = line.pull(
                data.site_xpos[self._chain.sections[index]],
                self._velocity(index) - self._hook_velocity,
                self._hook,
            )
            self._push_section(index, force)
        if inputs.hand is not None:
            hand, index = inputs.hand, self._section(inputs.hand.section)
            target = self._to_base(np.array(hand.position))
            push = self._into_base @ np.array(hand.force)
            position = data.site_xpos[self._chain.sections[index]]
            self._push_section(index, grasp(push, target, hand.stiffness, position, self._velocity(index)))
        for concealed in loads.forces:
            amplitude = self._into_base @ np.array(concealed.amplitude)
            self._push_section(self._section(concealed.section), strength(concealed, self._time) * amplitude)
        for tether in loads.tethers:
            index = self._section(tether.section)
            knot = data.site_xpos[self._chain.sections[index]]
            line = TautLine(tether.length, tether.stiffness, 0.2)
            self._push_section(index, line.pull(knot, self._velocity(index), np.array(tether.anchor))[0])
        if loads.obstacles:
            self._touch()

    def _touch(self) -> None:
        """Put the contact forces on the links."""
        points = self._data.xpos[self._chain.bodies]
        velocities = self._link_velocities()
        for obstacle in self._parameters.loads.obstacles:
            forces = contact(obstacle, points, self._chain.radii, velocities)
            for index in np.flatnonzero(forces.any(axis=1)):
                self._push(int(self._chain.bodies[index]), points[index], forces[index])
                self._section_forces[self._chain.link_sections[index]] += forces[index]

    def _push_section(self, index: int, force: Floats) -> None:
        """Put a force at the origin of a section's frame."""
        self._push(
            int(self._chain.section_bodies[index]), self._data.site_xpos[self._chain.sections[index]], force
        )
        self._section_forces[index] += force

    def _push(self, body: int, point: Floats, force: Floats) -> None:
        """Put a force on a body at a point."""
        self._data.xfrc_applied[body, :3] += force
        (x, y, z), (fx, fy, fz) = (point - self._data.xipos[body]).tolist(), force.tolist()
        self._data.xfrc_applied[body, 3:] += (y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)

    def _velocity(self, index: int) -> Floats:
        """Return the velocity of a section's origin in the base frame [m/s]."""
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(
            self._chain.model, self._data, OBJECT, int(self._chain.sections[index]), twist, 0
        )
        return twist[3:]

    def _link_velocities(self) -> Floats:
        """Return the velocities of the links' origins in the base frame [m/s], shape (links, 3)."""
        bodies, root = self._chain.bodies, self._chain.model.body_rootid[self._chain.bodies[0]]
        away = self._data.xpos[bodies] - self._data.subtree_com[root]
        twists = self._data.cvel[bodies]
        return np.asarray(twists[:, 3:] + np.cross(twists[:, :3], away))

    def _section(self, name: str) -> int:
        """Find a section by its name."""
        if name not in self.sections:
            raise InputError("section", f"no section '{name}'", f"one of {', '.join(self.sections)}")
        return self.sections.index(name)

    def _to_base(self, position: Floats) -> Floats:
        """Express a laboratory position in the base frame."""
        return np.asarray(self._into_base @ (position - self._origin))

    def _snapshot(self, inputs: PlantInputs) -> PlantState:
        """Describe the arm as it is now."""
        model, data = self._chain.model, self._data
        self._apply_loads(inputs)
        mujoco.mj_rnePostConstraint(model, data)
        count = len(self.sections)
        rotations = data.site_xmat[self._chain.sections].reshape(count, 3, 3)
        twists, accelerations = np.zeros((count, 6)), np.zeros((count, 6))
        for index, site in enumerate(self._chain.sections):
            mujoco.mj_objectVelocity(model, data, OBJECT, int(site), twists[index], 1)
            mujoco.mj_objectAcceleration(model, data, OBJECT, int(site), accelerations[index], 1)
        axes = np.einsum("sji,sj->si", rotations[:-1], rotations[1:, :, 2])
        return PlantState(
            time=self._time,
            chamber_pressures=self._pressures.copy(),
            positions=self._origin + data.site_xpos[self._chain.sections] @ self._into_base,
            quaternions=product(self._mount, product(data.xquat[self._chain.section_bodies], self._frames)),
            angular_velocities=twists[:, :3],
            specific_forces=accelerations[:, 3:],
            bends=tilt(axes),
            cord_force=self._tension,
            external_forces=self._section_forces @ self._into_base,
        )


def _numbered(groups: tuple[tuple[int, ...], ...]) -> NDArray[np.int64]:
    """Lay out the chambers of each segment in rows; -1 where a segment has fewer than another."""
    table = np.full((len(groups), max(map(len, groups))), -1)
    for segment, group in enumerate(groups):
        table[segment, : len(group)] = group
    return table


def _concealed(effect: str, value: object) -> Concealed | None:
    """Read the value of a switch."""
    if value is None or value == 0:
        return None
    if isinstance(value, Mapping):
        settings = dict(value)
        where = settings.pop("where", {})
        return Concealed(effect, dict(where), {name: float(number) for name, number in settings.items()})
    if isinstance(value, int | float):
        return Concealed(effect, {}, {"strength": float(value)})
    raise InputError(f"effect '{effect}'", f"value {value!r}", "give a number or a table of parameters")

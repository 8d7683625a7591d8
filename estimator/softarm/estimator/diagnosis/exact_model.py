"""The model itself under effects, at some samples of a session."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.effects import World
from softarm.estimator.effects.placed import PlacedEffect, met, signals_of
from softarm.estimator.effects.simulate import simulate_with
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.simulation import Drive, RespondingArm, Segments

APART = 0.8
"""Time [s] between samples at which the model itself is solved."""
PASSES, BALANCES = 4, 20
"""Answers of the model until effects see their own consequence, and within each until contacts balance, which
an arm that buckles at a wall may never do."""
SETTLED_STRAIN, SETTLED_WRENCH = 1e-4, 1e-5
"""Change of what effects do that ends the former: of strains and the base's rotation [rad, m], of wrenches
[N, N m]."""


@dataclass(frozen=True)
class ExactModel:
    """A model along a session.

    Args:
        arm: The model.
        drive: What acts on it without effects.
        baseline: Its response to that, which holds no eigenstrains.
        world: What effects may refer to.
        observed: The response without effects as these see it.
    """

    arm: RespondingArm
    drive: Drive
    baseline: ArmResponse
    world: World
    observed: ArmResponse

    @cached_property
    def nodes(self) -> Indices:
        """Samples at which the model itself is solved: one of every few, at random.

        At even steps they would see the same phase of every hold.
        """
        time = self.drive.time
        every = max(1, round(APART / float(np.median(np.diff(time))))) if len(time) > 1 else 1
        first = np.arange(0, len(time), every)
        drawn = first + np.random.default_rng(0).integers(0, every, len(first))
        nodes: Indices = np.minimum(drawn, len(time) - 1)
        return nodes

    def under(self, effects: Sequence[PlacedEffect]) -> tuple[Drive, ArmResponse]:
        """Solve the model under effects that see its own response.

        Effects keep their memory along all samples: between the nodes they see the response without them,
        moved as at the nodes. Loads of contact have none, and are found at the nodes alone.

        Returns:
            What acts in the end, and the response at the nodes, without derivatives.
        """
        plain, near = self.observed, self.baseline.at(self.nodes)
        answering = [placed for placed in effects if placed.effect.responds_to_own_effect]
        others = [placed for placed in effects if not placed.effect.responds_to_own_effect]
        drive = self._shaped(others, plain)
        loaded, response = self._answered(answering, drive, near)
        for _ in range(PASSES if others else 0):
            strained = self.between(response.strains - drive.eigenstrains[self.nodes] - near.strains)
            moved = self.between(response.frames.positions - near.frames.positions)
            there = Frames(plain.frames.positions + moved, plain.frames.rotations)
            again = self._shaped(others, replace(plain, frames=there, strains=plain.strains + strained))
            if _settled(drive, again):
                break
            drive = again
            loaded, response = self._answered(answering, drive, near.with_states(response.states))
        return loaded, response

    def _answered(
        self, answering: Sequence[PlacedEffect], drive: Drive, begun: ArmResponse
    ) -> tuple[Drive, ArmResponse]:
        """Solve the model at the nodes, with loads that answer to it where it would come upon them.

        Couples act in the pose without effects: those that followed the arm would yield otherwise than its
        compliance says, by which these loads are balanced.
        """
        nodes = self.nodes
        response = self.arm.respond(drive.at(nodes), begun, jacobians=False)
        if not answering:
            return drive, response
        offset = self.observed.frames.positions[nodes] - self.baseline.frames.positions[nodes]
        signals = signals_of(drive.at(nodes), self.world, _moved(response, offset))
        touching = met(answering, signals)
        if not len(touching):
            return drive, response
        arm, there = _ObservedArm(self.arm, offset[touching]), drive.at(nodes[touching])
        coupled = self.arm.segments.wrenches(begun.at(touching).frames, there.couples)
        fixed = replace(there, wrenches=there.wrenches + coupled, couples=np.zeros_like(there.couples))
        near = response.at(touching)
        simulation = simulate_with(answering, arm, self.world, fixed, near=near, passes=BALANCES)
        wrenches = drive.wrenches.copy()
        wrenches[nodes[touching]] = simulation.drive.wrenches - coupled
        answer = _moved(simulation.response, -offset[touching])
        response = response.with_samples(touching, answer)
        return replace(drive, wrenches=wrenches), _without(response, touching[simulation.unsettled])

    def between(self, values: Floats) -> Floats:
        """Interpolate between nodes, shape (nodes, ...), leaving out those without a value."""
        clock, nodes = self.drive.time, self.drive.time[self.nodes]
        columns = []
        for column in values.reshape(len(nodes), -1).T:
            known_nodes = np.isfinite(column)
            nearest = (
                np.interp(clock, nodes[known_nodes], column[known_nodes])
                if known_nodes.any()
                else np.zeros(len(clock))
            )
            columns.append(nearest)
        return np.stack(columns, axis=-1).reshape(len(clock), *values.shape[1:])

    def _shaped(self, effects: Sequence[PlacedEffect], response: ArmResponse) -> Drive:
        """Let effects act on the drive, as they see it in a response."""
        drive, signals = self.drive, signals_of(self.drive, self.world, response)
        for placed in effects:
            change, _ = placed.change(replace(signals, pressures=drive.pressures))
            drive = placed.apply(drive, change)
        return drive


def _settled(drive: Drive, again: Drive) -> bool:
    """Return whether effects do the same in two responses."""
    strain = float(np.abs(again.eigenstrains - drive.eigenstrains).max(initial=0.0))
    rotation = float(np.abs(again.base_rotation - drive.base_rotation).max(initial=0.0))
    wrench = float(np.abs(again.wrenches - drive.wrenches).max(initial=0.0))
    return max(strain, rotation) < SETTLED_STRAIN and wrench < SETTLED_WRENCH


class _ObservedArm:
    """A model whose sections effects see elsewhere, and which answers only what is new.

    Args:
        arm: The model.
        offset: From where its sections are to where effects see them [m], shape (samples, sections, 3).
    """

    def __init__(self, arm: RespondingArm, offset: Floats) -> None:
        self._arm, self._offset = arm, offset
        self._wrenches: Floats | None = None

    @property
    def segments(self) -> Segments:
        return self._arm.segments

    def respond(
        self, drive: Drive, near: ArmResponse | None = None, *, jacobians: bool = False
    ) -> ArmResponse:
        """Compute the response; ``near`` is the one before, from whose drive only wrenches differ."""
        before, self._wrenches = self._wrenches, drive.wrenches
        if near is None or before is None:
            return _moved(self._arm.respond(drive, near, jacobians=jacobians), self._offset)
        new = np.flatnonzero((drive.wrenches != before).any(axis=(1, 2)))
        answer = self._arm.respond(drive.at(new), near.at(new), jacobians=jacobians)
        return near.with_samples(new, _moved(answer, self._offset[new]))


def _without(response: ArmResponse, samples: Indices) -> ArmResponse:
    """Return a response with samples marked at which it is none."""
    converged = response.converged.copy()
    positions, strains = response.frames.positions.copy(), response.strains.copy()
    converged[samples], positions[samples], strains[samples] = False, np.nan, np.nan
    return replace(
        response, frames=Frames(positions, response.frames.rotations), converged=converged, strains=strains
    )


def _moved(response: ArmResponse, offset: Floats) -> ArmResponse:
    frames = Frames(response.frames.positions + offset, response.frames.rotations)
    return replace(response, frames=frames)

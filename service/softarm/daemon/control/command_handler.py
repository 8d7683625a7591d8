"""Checks and carries out commands, with one answer each."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from softarm.daemon.control.controller import Controller
from softarm.daemon.control.estimator_state import RECENT_S, EstimatorState
from softarm.daemon.control.hold import HoldGoal
from softarm.daemon.control.off_loop import off_loop
from softarm.daemon.control.poses import PoseStore, SavedPose
from softarm.daemon.control.recorder import Recorder, RecorderError
from softarm.daemon.estimation.messages import EstimationResult, HoldAnswer, PoseTarget
from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.lease import LeaseError
from softarm.daemon.safety.modes import PRESSURISED, Mode, TransitionRefusedError, Trigger
from softarm.drivers.errors import DeviceErrors, InterlockError, LimitError
from softarm.estimator.errors import InputError
from softarm_client.commands import (
    VERBS,
    Applied,
    DeviceReconnect,
    ErrorCode,
    GuardedRequest,
    LeaseAcquire,
    MovingRequest,
    RecordStart,
    Refused,
    Request,
    SetPressures,
    TeachGoto,
    TeachHold,
    TeachSave,
    malformed,
    sender,
)

logger = logging.getLogger(__name__)
RELEASE_LIFETIME_S = 2.0
"""Lifetime of the pressures after a release [s]: time for the client to send its own."""

CLOCKS_DIFFER_S = 1.0
"""Largest lead of a client's clock [s]: beyond it a command would outlive its caller."""
FARTHEST_DEADLINE_S = 60.0
ANSWER_S = 0.1
"""Time before its deadline at which a command that waits for an estimate is answered [s]."""
SAVE_S = 5.0
"""Longest wait for the disk that keeps a pose [s]: a service that ends waits for its commands."""
SET_CLOCKS = "set the clocks of both hosts by NTP (timedatectl)"

Answer = dict[str, object]


class RefusalError(Exception):
    """A command that is refused.

    Args:
        code: Why, for programs.
        message: Why, for people.
        hint: What to do about it.
    """

    def __init__(self, code: ErrorCode, message: str, hint: str) -> None:
        super().__init__(message)
        self.code = code
        self.hint = hint


MODE_HINTS: Mapping[Mode, str] = {
    Mode.STARTING: "wait until the service has started",
    Mode.IDLE: "acquire the lease and arm first",
    Mode.ARMED: "the arm is armed already: see the table of modes in docs/api.md",
    Mode.TEACH: "hold the pose with teach/hold, or go back to ARMED with teach/release",
    Mode.HOLDING: "go back to ARMED with teach/release",
    Mode.EXPERIMENT: "end the experiment with experiment/end",
    Mode.FAULTED: "clear the fault with clear, then arm",
    Mode.STOPPING: "wait until the service has been started again",
}
"""Hint for a command that is refused in a mode: how to leave it."""


@dataclass(frozen=True)
class CommandContext:
    """The parts of the service that the commands act on.

    Args:
        controller: Mode, lease and set-points.
        estimator_state: The newest estimate, the tare and the rest alignment.
        poses: Saved poses.
        attachments: Files kept in every recording.
        reconnect: Closes a device and connects it again.
        blocking: What keeps the service out of a mode.
        clock_ns: Monotonic clock.
        unix_ns: Wall clock.
    """

    controller: Controller
    estimator_state: EstimatorState
    recorder: Recorder
    poses: PoseStore
    attachments: Mapping[str, bytes]
    reconnect: Callable[[str], Awaitable[None]]
    blocking: Callable[[Mode], tuple[Diagnostic, ...]]
    clock_ns: Callable[[], int] = time.monotonic_ns
    unix_ns: Callable[[], int] = time.time_ns


class CommandHandler:
    """Carries out commands.

    Args:
        context: The parts of the service that they act on.
    """

    def __init__(self, context: CommandContext) -> None:
        self._context = context
        self._began_ns = context.clock_ns()
        self._saving, self._opening = asyncio.Lock(), asyncio.Lock()
        self._recording_lease: str | None = None
        # One table of verbs, that of the API: the method of `teach/start` is `_teach_start`.
        self._handlers: dict[str, Callable[[Any], Answer | Awaitable[Answer]]] = {
            verb: getattr(self, f"_{verb.replace('/', '_')}") for verb in VERBS if verb != "stop"
        }

    async def answer(self, verb: str, payload: bytes) -> Applied | Refused:
        """Check and carry out one command; whatever happens, there is one answer."""
        if verb == "stop":
            return self.stop(payload)
        try:
            request = self._checked(verb, payload)
            applied = self._handlers[verb](request)
            if not isinstance(applied, dict):
                applied = await applied
        except (RefusalError, LeaseError) as refusal:
            return Refused(verb=verb, code=refusal.code, message=str(refusal), hint=refusal.hint)
        except TransitionRefusedError as refusal:
            hint = MODE_HINTS[refusal.mode]
            return Refused(verb=verb, code="wrong_mode", message=str(refusal), hint=hint)
        except LimitError as refusal:
            return Refused(verb=verb, code="out_of_limit", message=refusal.what, hint=refusal.cure)
        except InterlockError as refusal:
            return Refused(verb=verb, code="not_available", message=refusal.what, hint=refusal.cure)
        except InputError as refusal:
            message = f"{refusal.where}: {refusal.what}"
            return Refused(verb=verb, code="not_available", message=message, hint=refusal.cure)
        except RecorderError as refusal:
            hint = "see the service's findings"
            return Refused(verb=verb, code="not_available", message=str(refusal), hint=hint)
        except OSError as refusal:
            message = f"{refusal.filename or 'the disk'}: {refusal.strerror or refusal}"
            hint = "check that the folder is there and may be written, and that the disk has room"
            return Refused(verb=verb, code="not_available", message=message, hint=hint)
        except Exception:  # one command must not end the service; nobody else would report it
            logger.exception("%s failed", verb)
            hint = "report this with the service's log"
            return Refused(verb=verb, code="internal", message="the command failed", hint=hint)
        return Applied(verb=verb, mode=self._context.controller.modes.mode, applied=applied)

    def stop(self, payload: bytes) -> Applied:
        """Vent and latch a fault, in every mode and from anybody; the payload matters only for the cause."""
        controller = self._context.controller
        if controller.modes.allows(Trigger.FAULT):  # a service that ends has vented already
            client = sender(payload)
            controller.fire(Trigger.FAULT, f"stopped by {client}", client)
        setpoint: Answer = {"asked_pa": controller.setpoint.tolist()}
        return Applied(verb="stop", mode=controller.modes.mode, applied=setpoint)

    def _checked(self, verb: str, payload: bytes) -> Request:
        model = VERBS.get(verb)
        if model is None:
            raise RefusalError("malformed", f"no verb {verb!r}", f"use one of {', '.join(VERBS)}")
        try:
            request = model.model_validate_json(payload)
        except ValidationError as error:
            refusal = malformed(verb, error)
            raise RefusalError(refusal.code, refusal.message, refusal.hint) from error
        self._refuse_stale(request)
        # The lease before the sequence: a command of another client must not use up a number of the holder.
        if isinstance(request, MovingRequest):
            self._context.controller.lease.check(request.lease, self._context.clock_ns())
            if not self._context.controller.lease.accept_sequence(request.sequence):
                raise RefusalError(
                    "stale", f"sequence {request.sequence} is not new", "increase it with every command"
                )
        if isinstance(request, GuardedRequest):
            self._check_holder(request)
        return request

    def _check_holder(self, request: Request) -> None:
        """Refuse a command that would disturb another client, which holds the lease."""
        lease, now_ns = self._context.controller.lease, self._context.clock_ns()
        if lease.holder(now_ns) is not None:
            lease.check(request.lease, now_ns)

    def _refuse_stale(self, request: Request) -> None:
        """Refuse a command after its deadline, or when the clocks of both hosts differ."""
        now_ns = self._context.unix_ns()
        # Without NTP a fresh command of another host looks stale: the refusal separates clock and delay.
        remaining_s = (request.deadline_unix_ns - now_ns) * 1e-9
        late_s = 0.0 if request.sent_unix_ns is None else (now_ns - request.sent_unix_ns) * 1e-9
        if late_s < -CLOCKS_DIFFER_S:
            message = f"the clock of the client's host is {-late_s:.1f} s ahead of the service's"
            raise RefusalError("stale", message, SET_CLOCKS)
        if remaining_s < 0.0 and late_s > CLOCKS_DIFFER_S:
            message = f"the command was sent {late_s:.1f} s ago, or the clock of its host is that far behind"
            raise RefusalError("stale", message, SET_CLOCKS)
        if remaining_s < 0.0:
            hint = f"send it again with a later deadline; if this repeats, {SET_CLOCKS}"
            raise RefusalError("stale", f"the deadline passed {-remaining_s:.3f} s ago", hint)
        if remaining_s > FARTHEST_DEADLINE_S:
            message = f"the deadline is {remaining_s:.1f} s ahead, more than {FARTHEST_DEADLINE_S:g} s"
            raise RefusalError("stale", message, f"send an earlier deadline; if it was early, {SET_CLOCKS}")

    def _refuse_blocked(self, mode: Mode, what: str = "") -> None:
        faults = self._context.blocking(mode)
        if faults:
            first = faults[0]
            message = f"{what or f'{mode} is not possible'}: {first.where}: {first.message}"
            raise RefusalError("not_available", message, first.hint)

    def _fire(self, trigger: Trigger, request: Request, did: str) -> Answer:
        """Change the mode on behalf of a client; the answer holds the set-points in force then."""
        controller = self._context.controller
        controller.fire(trigger, f"{request.client} {did}", request.client)
        return {"asked_pa": controller.setpoint.tolist()}

    def _arm(self, request: MovingRequest) -> Answer:
        self._refuse_blocked(Mode.ARMED)
        return self._fire(Trigger.ARM, request, "armed")

    def _disarm(self, request: MovingRequest) -> Answer:
        return self._fire(Trigger.DISARM, request, "disarmed")

    def _clear(self, request: Request) -> Answer:
        """Clear a fault; errors that the valves keep are acknowledged, and clear themselves."""
        controller = self._context.controller
        cause = controller.modes.fault_cause
        # The terminal keeps its errors until they are acknowledged, so their cause cannot be gone before.
        acknowledged = controller.modes.allows(Trigger.CLEAR) and controller.acknowledge()
        if controller.modes.mode is Mode.FAULTED and not acknowledged:
            self._refuse_blocked(Mode.ARMED, "the cause of the fault is still there")
        controller.fire(Trigger.CLEAR, f"cleared by {request.client}", request.client)
        return {"cleared": cause, "acknowledged": acknowledged}

    def _set_pressures(self, request: SetPressures) -> Answer:
        controller = self._context.controller
        if controller.modes.mode not in (Mode.ARMED, Mode.EXPERIMENT):
            message = f"set-points are not accepted in {controller.modes.mode}"
            raise RefusalError("wrong_mode", message, MODE_HINTS[controller.modes.mode])
        setpoint = controller.request_setpoint(
            np.array(request.pressures_pa), request.lifetime_s, self._context.clock_ns()
        )
        return {"asked_pa": setpoint.tolist(), "lifetime_s": request.lifetime_s}

    def _teach_start(self, request: MovingRequest) -> Answer:
        self._refuse_blocked(Mode.TEACH)
        return self._fire(Trigger.TEACH, request, "teaches")

    async def _teach_hold(self, request: TeachHold) -> Answer:
        self._refuse_blocked(Mode.HOLDING)
        hold, estimate = await self._wait_for_hold(request)
        pose = PoseTarget(estimate.positions, estimate.quaternions, hold.residuals)
        goal = HoldGoal(hold.pressures, pose)
        self._begin_hold(goal, request, f"{request.client} holds")
        return {
            "pressures_pa": hold.pressures.tolist(),
            "ramp_s": request.ramp_s,
            "reachable": hold.reachable,
            "note": hold.note,
        }

    async def _wait_for_hold(self, request: Request) -> tuple[HoldAnswer, EstimationResult]:
        """Wait for the pressures that hold the pose, and return them with the estimate of that pose.

        Raises:
            RefusalError: There are none, or the mode changed while the command waited.
        """
        estimator_state, modes = self._context.estimator_state, self._context.controller.modes
        # The mode may change and change back while this waits: count changes, do not compare modes.
        changes = modes.changes
        if modes.mode in (Mode.TEACH, Mode.HOLDING):
            remaining_s = (request.deadline_unix_ns - self._context.unix_ns()) * 1e-9
            await estimator_state.wait_for_hold(remaining_s - ANSWER_S, lambda: modes.changes != changes)
        if modes.changes != changes:
            message = f"the arm changed to {modes.mode} while the command waited for an estimate"
            raise RefusalError("wrong_mode", message, MODE_HINTS[modes.mode])
        if estimator_state.held is not None:
            return estimator_state.held
        if estimator_state.hold_answer is not None:
            hint = "move the arm to another pose: no pressures are known that hold this one"
            raise RefusalError("not_available", estimator_state.hold_answer.note, hint)
        if modes.mode in (Mode.TEACH, Mode.HOLDING):
            message = f"no estimate of the last {RECENT_S:g} s gave pressures for this pose in time"
            raise RefusalError("not_available", message, "see the service's findings, then try again")
        cause = f" ({modes.fault_cause})" if modes.fault_cause else ""
        hint = "begin with teach/start" if modes.mode in PRESSURISED else MODE_HINTS[modes.mode]
        message = f"no pressures that hold the pose are computed in {modes.mode}{cause}"
        raise RefusalError("wrong_mode", message, hint)

    def _begin_hold(self, goal: HoldGoal, request: TeachHold | TeachGoto, cause: str) -> None:
        now_ns = self._context.clock_ns()
        self._context.controller.begin_hold(goal, request.ramp_s, now_ns, cause, request.client)

    async def _teach_save(self, request: TeachSave) -> Answer:
        hold, estimate = await self._wait_for_hold(request)
        controller = self._context.controller
        # Feedback has corrected the pressures in force, but not the model's own answer.
        held = controller.modes.mode is Mode.HOLDING
        pressures = controller.setpoint if held else hold.pressures
        pose = SavedPose(
            pressures_pa=tuple(float(p) for p in pressures),
            sections=self._context.estimator_state.section_poses(estimate),
            reachable=hold.reachable,
            note=hold.note,
            saved_unix_ns=self._context.unix_ns(),
        )
        async with self._saving:  # one after the other: each writes the whole file
            try:
                await asyncio.wait_for(off_loop(lambda: self._context.poses.save(request.name, pose)), SAVE_S)
            except TimeoutError:
                message = f"the disk did not answer within {SAVE_S:g} s"
                raise RefusalError("not_available", message, "check the disk, then save again") from None
        return {
            "name": request.name,
            "pressures_pa": list(pose.pressures_pa),
            "reachable": pose.reachable,
            "note": pose.note,
        }

    def _teach_list(self, request: Request) -> Answer:
        del request
        return {name: self._context.poses.get(name) for name in self._context.poses.names}

    def _teach_goto(self, request: TeachGoto) -> Answer:
        pose = self._context.poses.get(request.name)
        if pose is None:
            known = ", ".join(self._context.poses.names) or "none"
            raise RefusalError("not_available", f"no pose {request.name!r}", f"saved poses: {known}")
        self._refuse_blocked(Mode.HOLDING)
        goal = HoldGoal(np.array(pose.pressures_pa), pose.target)
        self._begin_hold(goal, request, f"{request.client} moves to {request.name}")
        return {
            "name": request.name,
            "pressures_pa": list(pose.pressures_pa),
            "ramp_s": request.ramp_s,
            "reachable": pose.reachable,
            "note": pose.note,
        }

    def _teach_release(self, request: MovingRequest) -> Answer:
        released = self._fire(Trigger.RELEASE, request, "released")
        self._context.controller.keep_setpoint(self._context.clock_ns(), RELEASE_LIFETIME_S)
        return released | {"lifetime_s": RELEASE_LIFETIME_S}

    def _estimate_tare(self, request: Request) -> Answer:
        del request
        tare = self._context.estimator_state.tare_now()
        if tare is None:
            raise RefusalError("not_available", "no estimate to tare", "wait for one that converged")
        return {"loads_n": tare.tolist()}

    def _experiment_begin(self, request: MovingRequest) -> Answer:
        self._refuse_blocked(Mode.EXPERIMENT)
        self._fire(Trigger.EXPERIMENT_BEGIN, request, "begins")
        return {}

    def _experiment_end(self, request: MovingRequest) -> Answer:
        self._fire(Trigger.EXPERIMENT_END, request, "ends")
        return {}

    def _calibrate_rest(self, request: Request) -> Answer:
        del request
        if self._context.controller.modes.mode is not Mode.IDLE:
            raise RefusalError("wrong_mode", "the arm must hang vented and free", "disarm first")
        aligned = self._context.estimator_state.align_at_rest()
        return {"aligned": list(aligned)}

    async def _record_start(self, request: RecordStart) -> Answer:
        # A second command would wait for a disk that hangs already.
        if self._opening.locked():
            raise RefusalError("busy", "a recording is being opened", "wait for the answer to that command")
        since_s = (self._context.clock_ns() - self._began_ns) * 1e-9
        info = {"session_start_s": round(since_s, 3), "started_by": request.client}
        recorder, attachments = self._context.recorder, self._context.attachments
        async with self._opening:
            path = await off_loop(lambda: recorder.start(request.name, attachments, info))
        self._recording_lease = request.lease
        return {"path": str(path)}

    async def _record_stop(self, request: Request) -> Answer:
        """End the recording; that of the holder of the lease is ended by the holder alone."""
        if self._context.controller.lease.is_current(self._recording_lease, self._context.clock_ns()):
            self._check_holder(request)
        path, dropped = await off_loop(self._context.recorder.stop)
        return {"path": str(path), "dropped": dropped}

    async def _device_reconnect(self, request: DeviceReconnect) -> Answer:
        mode = self._context.controller.modes.mode
        # To close the valve bank is to vent; to close a camera in TEACH would be a fault.
        if mode in PRESSURISED:
            raise RefusalError("wrong_mode", f"no device is reconnected in {mode}", "disarm first")
        try:
            await self._context.reconnect(request.device)
        except KeyError:
            hint = "give the name of a device in the configuration"
            raise RefusalError("malformed", f"no device {request.device!r}", hint) from None
        except DeviceErrors as errors:
            error = next(errors.leaves())
            raise RefusalError("not_available", f"{error.device}: {error.what}", error.cure) from errors
        return {"device": request.device}

    def _lease_acquire(self, request: LeaseAcquire) -> Answer:
        lease = self._context.controller.lease.acquire(
            request.client, self._context.clock_ns(), request.lease
        )
        remaining_s = (lease.expires_ns - self._context.clock_ns()) * 1e-9
        return {"lease": lease.token, "remaining_s": round(remaining_s, 3)}

    def _lease_release(self, request: MovingRequest) -> Answer:
        # Vent before the lease is free: the next client must find the arm without pressure.
        controller = self._context.controller
        if controller.modes.allows(Trigger.LEASE_LOST):
            controller.fire(Trigger.LEASE_LOST, f"{request.client} released the lease", request.client)
        controller.lease.release(request.lease, self._context.clock_ns())
        return {}

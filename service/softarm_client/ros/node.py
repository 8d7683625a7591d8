"""The node: publishes what comes from the arm, and passes on what callers ask for."""

import os
import signal
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from typing import Any

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from softarm_client.arm import Arm
from softarm_client.errors import ClientError, SetupError
from softarm_client.messages import Estimate, Event, State
from softarm_client.results import Hold
from softarm_client.ros.diagnostics import Diagnostics
from softarm_client.ros.interface import PARAMETERS, SET_PRESSURES, SUBSCRIBED, TRANSFORMS, ros_name
from softarm_client.ros.messages import ArmMessages, Outgoing
from softarm_client.ros.services import Do, LeaseKeeper, answer, verbs

NODE = "softarm"
ARGUMENTS = "write what follows --ros-args as docs/ros.md does"
REPORT_S = 1.0
POSES_S = 2.0
"""Time between two looks at which poses are saved."""
DEPTH = 10
THREADS = 4
"""Threads for callbacks: stop, set-points, reports and the other commands never wait for each other."""


def ros_class(name: str) -> Any:
    """Import the class of a ROS 2 message by its name, such as ``std_msgs/msg/Bool``."""
    package, kind, message = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), message)


class ArmNode:
    """The node of one arm, at work within the block; rclpy is initialised before.

    Args:
        arm: Client of the arm; whoever opened it closes it.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._node = Node(NODE, namespace=ros_name(arm.keys.arm))
        self._log = self._node.get_logger()
        self._publishers: dict[str, Any] = {}
        self._poses: dict[str, Any] = {}
        self._commands = MutuallyExclusiveCallbackGroup()
        self._messages = ArmMessages(arm.keys.arm, ros_class, self._has_transforms())
        self._diagnostics = Diagnostics(arm.keys.arm, ros_class)
        self._lease = LeaseKeeper(arm, lambda reason: self._log.error(reason))
        self._exit = ExitStack()

    def __enter__(self) -> "ArmNode":
        for name, (default, _) in PARAMETERS.items():
            self._node.declare_parameter(name, default)
        self._offer_services()
        with ExitStack() as opening:
            opening.callback(self._node.destroy_node)
            opening.callback(self._lease.release)
            for subscription in (
                self._arm.states().subscribe(self._on_state),
                self._arm.estimates().subscribe(self._on_estimate),
                self._arm.mismatches().subscribe(self._diagnostics.note_mismatch),
                self._arm.events().subscribe(self._on_event),
            ):
                opening.enter_context(subscription)
            opening.enter_context(_spinning(self._node))
            self._exit = opening.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    @property
    def name(self) -> str:
        """The node's name with its namespace."""
        return str(self._node.get_fully_qualified_name())

    def _has_transforms(self) -> bool:
        try:
            ros_class(TRANSFORMS)
        except ImportError as error:
            self._log.warning(f"/tf is not published ({error}): tf2_msgs comes with an installation of ROS 2")
            return False
        return True

    def _offer_services(self) -> None:
        group, node = MutuallyExclusiveCallbackGroup, self._node
        for name, do in verbs(self._arm, self._lease, self._parameter).items():
            self._offer(name, do, group() if name == "stop" else self._commands)
        kind, _ = SUBSCRIBED[SET_PRESSURES]
        node.create_subscription(
            ros_class(kind), SET_PRESSURES, self._on_set_points, 1, callback_group=group()
        )
        node.create_timer(REPORT_S, self._report, callback_group=group())
        node.create_timer(POSES_S, self._offer_poses, callback_group=self._commands)

    def _offer(self, name: str, do: Do, group: MutuallyExclusiveCallbackGroup) -> Any:
        def call(_: Any, response: Any) -> Any:
            response.success, response.message = answer(do)
            return response

        return self._node.create_service(Trigger, name, call, callback_group=group)

    def _offer_poses(self) -> None:
        """Offer a service for each saved pose."""
        try:
            saved = self._arm.teach.poses()
        except ClientError:  # the diagnostics tell that the service is silent
            return
        for name in set(self._poses) - set(saved):
            self._node.destroy_service(self._poses.pop(name))
        for name in set(saved) - set(self._poses):
            if ros_name(name) == name:
                self._poses[name] = self._offer(
                    f"teach/goto/{name}", partial(self._goto, name), self._commands
                )
            else:
                text = f"pose {name!r} has no service: ROS 2 takes letters, digits and underscores only"
                self._log.warning(text, once=True)

    def _goto(self, name: str) -> Hold:
        return self._arm.teach.goto(name, float(self._parameter("ramp_s")))

    def _parameter(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def _on_state(self, state: State) -> None:
        self._diagnostics.note_state(state)
        self._publish(self._messages.of_state(state))

    def _on_estimate(self, estimate: Estimate) -> None:
        self._diagnostics.note_estimate(estimate)
        self._publish(self._messages.of_estimate(estimate))

    def _on_event(self, event: Event) -> None:
        self._log.info(f"{event.where}: {event.text}")

    def _on_set_points(self, message: Any) -> None:
        lifetime_s = float(self._parameter("set_point_lifetime_s"))
        try:
            self._arm.pressures.set(message.data, lifetime_s)
        except ClientError as error:
            self._log.warning(str(error), throttle_duration_sec=1.0)

    def _report(self) -> None:
        self._publish([self._diagnostics.report()])

    def _publish(self, messages: Iterable[Outgoing]) -> None:
        for outgoing in messages:
            if outgoing.topic not in self._publishers:
                publisher = self._node.create_publisher(ros_class(outgoing.type), outgoing.topic, DEPTH)
                self._publishers[outgoing.topic] = publisher
            self._publishers[outgoing.topic].publish(outgoing.message)


@contextmanager
def _spinning(node: Node) -> Iterator[None]:
    """Carry out a node's callbacks within the block, in threads of their own."""
    executor = MultiThreadedExecutor(THREADS)
    executor.add_node(node)
    with ThreadPoolExecutor(1, "softarm-ros") as pool:
        spinning = pool.submit(executor.spin)
        spinning.add_done_callback(_end_if_failed)
        try:
            yield
        finally:
            executor.shutdown()
    spinning.result()


def _end_if_failed(spinning: "Future[None]") -> None:
    """End the process when its callbacks are no longer carried out: a node without services must not live."""
    if spinning.exception() is not None:
        os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def running_node(arm: Arm, arguments: Sequence[str]) -> Iterator[ArmNode]:
    """Run the node of an arm within the block.

    Args:
        arm: Client of the arm; whoever opened it closes it.
        arguments: Arguments of ROS 2, such as ``--ros-args -r __ns:=/laboratory``.

    Yields:
        The node.

    Raises:
        SetupError: ROS 2 does not take the arguments.
    """
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise SetupError("ROS 2", f"does not start ({error})", ARGUMENTS) from error
    try:
        with ArmNode(arm) as node:
            yield node
    except ParameterException as error:
        raise SetupError("ROS 2", str(error), ARGUMENTS) from error
    finally:
        rclpy.try_shutdown()

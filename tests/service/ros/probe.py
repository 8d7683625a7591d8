"""A node of a user, who has ROS 2 and nothing of softarm: answers each line on stdin with a line of JSON.

A line is the name of a method of ``Probe`` and its arguments.
"""

import json
import sys
from importlib import import_module

import rclpy
from rcl_interfaces.msg import Log, Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

PATIENCE_S = 30.0


class Probe:
    """The user's node."""

    def __init__(self):
        self.node = rclpy.create_node("probe")
        self.logged = []
        self.node.create_subscription(Log, "/rosout", lambda entry: self.logged.append(entry.msg), 100)

    def take(self, kind, topic):
        """Answer with the next message of a topic, as CDR in hexadecimal."""
        package, _, name = kind.split("/")
        kind, taken = getattr(import_module(f"{package}.msg"), name), []
        subscription = self.node.create_subscription(kind, topic, taken.append, 10, raw=True)
        self._until(lambda: taken)
        self.node.destroy_subscription(subscription)
        return taken[0].hex() if taken else None

    def log(self, word):
        """Answer with the next line of the log that has a word."""
        self._until(lambda: any(word in line for line in self.logged))
        found = next((line for line in self.logged if word in line), None)
        self.logged.clear()
        return found

    def call(self, service):
        answer = self._ask(Trigger, service, Trigger.Request())
        return [answer.success, answer.message]

    def set(self, service, name, value):
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
        return self._ask(SetParameters, service, request).results[0].successful

    def publish(self, topic, *numbers):
        publisher = self.node.create_publisher(Float64MultiArray, topic, 1)
        self._until(publisher.get_subscription_count)
        publisher.publish(Float64MultiArray(data=[float(number) for number in numbers]))
        publisher.wait_for_all_acked()
        self.node.destroy_publisher(publisher)
        return True

    def names(self):
        return {
            "topics": dict(self.node.get_topic_names_and_types()),
            "services": dict(self.node.get_service_names_and_types()),
        }

    def _ask(self, kind, service, request):
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(PATIENCE_S), service
        answer = client.call_async(request)
        rclpy.spin_until_future_complete(self.node, answer, timeout_sec=PATIENCE_S)
        self.node.destroy_client(client)
        return answer.result()

    def _until(self, accept):
        """Handle what comes until a condition holds, at most for as long as a patient user waits."""
        deadline = self.node.get_clock().now().nanoseconds + PATIENCE_S * 1e9
        while not accept() and self.node.get_clock().now().nanoseconds < deadline:
            rclpy.spin_once(self.node, timeout_sec=0.1)


rclpy.init()
probe = Probe()
for line in sys.stdin:
    verb, *words = line.split()
    print(json.dumps(getattr(probe, verb)(*words)), flush=True)
rclpy.try_shutdown()

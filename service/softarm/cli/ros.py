"""``softarm ros``: a running arm as a ROS 2 node."""

from pathlib import Path

import click

from softarm.cli.output import notify
from softarm.cli.running_arm import arm_options
from softarm_client.ros.bridge import serve


@click.command(context_settings={"ignore_unknown_options": True})
@arm_options
@click.argument("arguments", metavar="[--ros-args ...]", nargs=-1, type=click.UNPROCESSED)
def command(arm: str, endpoint: str, zenoh_config: Path | None, arguments: tuple[str, ...]) -> None:
    """Offer a running arm in ROS 2: poses, forces, pressures and diagnostics as topics, commands as services.

    The command needs rclpy, which comes with ROS 2; docs/ros.md describes how to get it, and lists topics and
    services. It waits for the arm's service and runs until Ctrl-C.

    Example: softarm ros --arm sopra --endpoint tcp/192.168.1.20:7447
    """
    serve(arm, endpoint, zenoh_config, arguments, notify)

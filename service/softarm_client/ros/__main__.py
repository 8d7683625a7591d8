"""``python -m softarm_client.ros``: the node on a machine that has the client only."""

import argparse
import sys
from functools import partial
from pathlib import Path

from softarm_client.errors import ClientError, SetupError
from softarm_client.ros.bridge import serve
from softarm_client.session import DEFAULT_ENDPOINT


def main() -> int:
    """Run the node; return 0 done, 1 the work failed, 2 wrong use."""
    parser = argparse.ArgumentParser("python -m softarm_client.ros", allow_abbrev=False)
    parser.description, parser.epilog = "Offer an arm in ROS 2.", "What follows --ros-args goes to ROS 2."
    parser.add_argument("--arm", required=True, help="name of the arm")
    parser.add_argument("--endpoint", default=DEFAULT_ENDPOINT, help="zenoh endpoint of its service")
    parser.add_argument("--zenoh", type=Path, help="JSON5 file with credentials")
    arguments, ros = parser.parse_known_args()
    try:
        serve(
            arguments.arm,
            arguments.endpoint,
            arguments.zenoh,
            ros,
            partial(print, file=sys.stderr, flush=True),
        )
    except ClientError as error:
        print(f"softarm: {error}", file=sys.stderr)
        return 2 if isinstance(error, SetupError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

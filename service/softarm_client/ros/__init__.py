"""An arm as a ROS 2 node: its streams as standard messages, its commands as services."""

"""The mind on a ROS 2 robot, over Zenoh as rmw_zenoh speaks it, without any part of ROS (docs/ros2.md)."""

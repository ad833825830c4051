"""Robots on the bus for ROS 2 and Foxglove: topics, conversions, `cmd_vel` as an operator.

`ros_topics`, `ros_messages`, `frames` and `cmd_vel` are pure: the caller passes in messages and
time, and performs the returned actions. `cmd_vel_bridge` performs them with the client library.
"""

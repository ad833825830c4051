"""ROS 2 bridge: robots on the bus as ROS nodes, and third-party ROS robots on the bus.

Uses the rmw_zenoh protocol or rclpy; `cmd_vel` drives the robots.
"""

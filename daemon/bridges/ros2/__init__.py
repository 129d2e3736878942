"""Native ROS 2 topics without ROS, in the protocol of rmw_zenoh (docs/how-to/ros2.md).

`messages` encodes the content, `node` holds topics and their addresses, `bridge` decides when to
publish. `urdf` describes the arm.
"""

"""Native ROS 2 topics without ROS: the dialect of rmw_zenoh (docs/how-to/ros2.md).

`messages` is what is said, `dialect` how it is addressed, `node` who says it, `bridge` when;
`urdf` draws the arm.
"""

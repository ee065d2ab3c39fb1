"""Names of the message types that are spoken."""

from __future__ import annotations

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"
MAP = "nav_msgs/msg/OccupancyGrid"
POSE_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POSE = "geometry_msgs/msg/PoseStamped"
POSES = "geometry_msgs/msg/PoseArray"
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
PEOPLE = "spencer_tracking_msgs/msg/TrackedPersons"
CLOCK = "rosgraph_msgs/msg/Clock"
TEXT = "std_msgs/msg/String"
SWITCH = "std_msgs/msg/Bool"
JOYSTICK = "sensor_msgs/msg/Joy"

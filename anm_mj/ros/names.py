"""Topics, message types and frames of both sides: those that ROS 2 robots have (REP 103, 105, 118)."""

MAP, ODOM, BASE, CAMERA, WORLD = "map", "odom", "base_link", "camera_optical_frame", "world"
"""Frames; the world is that of the simulated scene, for the ground truth only."""

COLOUR, COLOUR_INFO = "camera/color/image_raw", "camera/color/camera_info"
DEPTH, DEPTH_INFO = "camera/depth/image_raw", "camera/depth/camera_info"
ODOMETRY, COMMAND, CLOCK, TRUTH, JOINTS = "odom", "cmd_vel", "/clock", "ground_truth/odom", "joint_states"
TF, TF_STATIC = "tf", "tf_static"

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, JOINT_STATE = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/JointState"
ODOMETRY_TYPE, TF_TYPE, CLOCK_TYPE = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Clock"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"

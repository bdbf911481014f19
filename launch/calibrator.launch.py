"""Start the calibrator: ros2 launch fisheye_ep_calib calibrator.launch.py parameters:=my_cameras.yaml"""

from launch import LaunchDescription

from fisheye_ep_calib.ros.launching import describe_node


def generate_launch_description() -> LaunchDescription:
    return describe_node("calibrator")

"""Start the rectifier: ros2 launch fisheye_ep_calib rectifier.launch.py camera_file:=front.yaml topic:=/image_raw"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue

from fisheye_ep_calib.ros.launching import describe_node


def generate_launch_description() -> LaunchDescription:
    arguments = [
        DeclareLaunchArgument("camera_file", description="camera file (YAML) of the camera that sends the images"),
        DeclareLaunchArgument("topic", default_value="image_raw", description="image topic, without /compressed"),
        DeclareLaunchArgument(
            "distance", default_value="0.0", description="metres at which the image is right; 0: infinity"
        ),
    ]
    types = {"camera_file": str, "topic": str, "distance": float}
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, kind in types.items()}
    return describe_node("rectifier", arguments, parameters)

"""Start the rectifier: ros2 launch fisheye_ep_calib rectifier.launch.py camera_file:=front.yaml topic:=/image_raw"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    default_parameters = PathJoinSubstitution([FindPackageShare("fisheye_ep_calib"), "config", "rectifier.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("camera_file", description="camera file (YAML) of the camera that sends the images"),
            DeclareLaunchArgument("topic", default_value="image_raw", description="image topic, without /compressed"),
            DeclareLaunchArgument(
                "distance", default_value="0.0", description="metres at which the image is right; 0: infinity"
            ),
            DeclareLaunchArgument(
                "parameters", default_value=default_parameters, description="parameter file (YAML) with all else"
            ),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
            DeclareLaunchArgument("name", default_value="rectifier", description="name of the node"),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="follow /clock, as with a played bag"
            ),
            DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn or error"),
            Node(
                package="fisheye_ep_calib",
                executable="rectifier",
                name=LaunchConfiguration("name"),
                namespace=LaunchConfiguration("namespace"),
                output="screen",
                emulate_tty=True,
                ros_arguments=["--log-level", LaunchConfiguration("log_level")],
                parameters=[
                    LaunchConfiguration("parameters"),
                    {
                        "camera_file": ParameterValue(LaunchConfiguration("camera_file"), value_type=str),
                        "topic": ParameterValue(LaunchConfiguration("topic"), value_type=str),
                        "distance": ParameterValue(LaunchConfiguration("distance"), value_type=float),
                        "use_sim_time": LaunchConfiguration("use_sim_time"),
                    },
                ],
            ),
        ]
    )

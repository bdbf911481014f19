"""Start the calibrator: ros2 launch fisheye_ep_calib calibrator.launch.py parameters:=my_cameras.yaml"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    default_parameters = PathJoinSubstitution([FindPackageShare("fisheye_ep_calib"), "config", "calibrator.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("parameters", default_value=default_parameters, description="parameter file (YAML)"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
            DeclareLaunchArgument("name", default_value="calibrator", description="name of the node"),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="follow /clock, as with a played bag"
            ),
            DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn or error"),
            Node(
                package="fisheye_ep_calib",
                executable="calibrator",
                name=LaunchConfiguration("name"),
                namespace=LaunchConfiguration("namespace"),
                output="screen",
                emulate_tty=True,
                ros_arguments=["--log-level", LaunchConfiguration("log_level")],
                parameters=[
                    LaunchConfiguration("parameters"),
                    {"use_sim_time": LaunchConfiguration("use_sim_time")},
                ],
            ),
        ]
    )

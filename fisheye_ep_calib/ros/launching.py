"""What the launch files of both nodes have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "fisheye_ep_calib"


def describe_node(
    executable: str, arguments: Sequence[DeclareLaunchArgument] = (), parameters: Mapping[str, Any] | None = None
) -> LaunchDescription:
    """One node, with the parameter file config/<executable>.yaml unless another is given.

    arguments: those that only this node has. parameters: what is set from them, above the file.
    """
    file = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", f"{executable}.yaml"])
    common = [
        DeclareLaunchArgument("parameters", default_value=file, description="parameter file (YAML)"),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
        DeclareLaunchArgument("name", default_value=executable, description="name of the node"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="follow /clock, as with a played bag"),
        DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn or error"),
    ]
    node = Node(
        package=PACKAGE,
        executable=executable,
        name=LaunchConfiguration("name"),
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        emulate_tty=True,
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        parameters=[
            LaunchConfiguration("parameters"),
            {**(parameters or {}), "use_sim_time": LaunchConfiguration("use_sim_time")},
        ],
    )
    return LaunchDescription([*arguments, *common, node])

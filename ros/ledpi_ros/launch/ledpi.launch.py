"""The node, with its parameters from config/ledpi.yaml, or from params:=FILE, in namespace:=NAME."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    shipped = PathJoinSubstitution([FindPackageShare("ledpi_ros"), "config", "ledpi.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=shipped, description="A file of parameters"),
            DeclareLaunchArgument("namespace", default_value="", description="What topics and node are in"),
            Node(
                package="ledpi_ros",
                executable="ledpi",
                name="ledpi",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params")],
            ),
        ]
    )

"""The page on a folder of datasets: `ros2 launch robot_calibration_inspector_ros page.launch.py data:=FOLDER`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Serve a folder of datasets at 127.0.0.1."""
    data, port = LaunchConfiguration("data"), LaunchConfiguration("port")
    return LaunchDescription(
        [
            DeclareLaunchArgument("data", description="folder with datasets"),
            DeclareLaunchArgument("port", default_value="8080"),
            ExecuteProcess(cmd=["inspector", "serve", data, "--port", port], output="screen"),
        ]
    )

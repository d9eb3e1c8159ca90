"""Installs the package for `ros2 run` and `ros2 launch`."""

from setuptools import setup

NAME = "robot_calibration_inspector_ros"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/page.launch.py"]),
    ],
    install_requires=["setuptools", "robot-calibration-inspector[page,logs,xacro]==1.0.0"],
    entry_points={"console_scripts": [f"inspector = {NAME}.run:command"]},
)

"""The command `inspector` for `ros2 run`, without the arguments that ROS adds to a node's."""

from __future__ import annotations

import sys

from inspector.__main__ import command as inspector

ROS_ARGS, END = "--ros-args", "--"


def without_ros_args(arguments: list[str]) -> list[str]:
    """Arguments without what stands between `--ros-args` and `--` or the end."""
    if ROS_ARGS not in arguments:
        return arguments
    first = arguments.index(ROS_ARGS)
    rest = arguments[first + 1 :]
    return arguments[:first] + (rest[rest.index(END) + 1 :] if END in rest else [])


def command() -> object:
    """Run `inspector` with the arguments of the process."""
    sys.argv[1:] = without_ros_args(sys.argv[1:])
    return inspector()

"""The robot calibration inspector for `ros2 run`."""

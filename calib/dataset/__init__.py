"""What was measured: the robot, its poses, the measured points, and their repeats."""

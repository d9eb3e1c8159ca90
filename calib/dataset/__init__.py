"""The measured data: robot, poses, measured points and their repeats."""

"""The tool point where robot.toml has it far from where the measured points have it: found before the link errors."""

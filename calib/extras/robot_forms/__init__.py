"""Further forms of a robot's file: xacro, MuJoCo's models and the calibration.conf of Universal Robots."""

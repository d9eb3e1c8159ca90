"""Robot calibration from scans of a three-faced jig: corners, five-parameter kinematics, what can be known."""

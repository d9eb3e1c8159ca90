"""Import of what a camera measured: images of a board or a ball, marker poses, lenses, poses of the flange."""

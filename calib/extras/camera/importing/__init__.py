"""Import of what a camera measured: images of a board, marker poses, lenses, poses of the flange."""

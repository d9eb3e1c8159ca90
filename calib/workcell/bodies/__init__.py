"""The solids of an arm, its jig and its surroundings, and how near they come to each other and to lines of sight."""

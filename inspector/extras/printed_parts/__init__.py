"""Parts to print for measuring: the command `jig`."""

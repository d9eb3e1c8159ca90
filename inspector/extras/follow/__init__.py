"""A campaign while it is measured: the command `follow`."""

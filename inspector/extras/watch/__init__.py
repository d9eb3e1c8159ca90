"""The same cell measured again: the command `watch`."""

"""The tools of the comparison, a module each; nothing of this project is imported by any but `ours`."""

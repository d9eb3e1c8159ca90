"""Folders as owners of an arm that is off would send them, each with a known cause; no code is shared with calib."""

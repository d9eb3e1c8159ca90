"""A reader for each file format of a scan."""

"""Robot descriptions in users' formats, read and written: URDF, xacro, MJCF, tables, makers' files."""

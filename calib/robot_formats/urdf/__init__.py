"""URDF and xacro: safe reading, the serial arm in a URDF, and writing by changing origins only."""

"""Robots in the forms that users have them in: URDF, tables of other schools, makers' files; in and out."""

"""Extras of the method: each folder is a plug-in that can be taken away, and no other room imports it."""

"""Extras of commands and page: each folder is a plug-in that can be taken away; no other room imports it."""

"""Conversion of corners to measured points, with the jig's faces labelled alike at every pose."""

"""Recordings of an arm that stops at poses: joints and points by time, averaged while it stands."""

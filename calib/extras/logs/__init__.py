"""Recordings of an arm that stops at poses: bags and logs by time, one row a stop."""

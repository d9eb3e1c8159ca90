"""Causes shown by intervention: poses measured again with one condition changed, and what their differences prove."""

"""Joint targets with which the real arm goes where the nominal one was commanded to."""

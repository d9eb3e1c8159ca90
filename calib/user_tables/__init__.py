"""Tables as users have them: any separator, units in the names of columns."""

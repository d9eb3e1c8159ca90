"""Physical effects: how a real arm and scanner differ from the nominal ones at each pose."""

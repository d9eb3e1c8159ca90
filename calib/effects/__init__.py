"""Physical effects: how a real arm and scanner, at each pose, differ from the nominal ones."""

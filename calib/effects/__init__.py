"""Physical effects: what turns the nominal robot's state at each pose into the real one's."""

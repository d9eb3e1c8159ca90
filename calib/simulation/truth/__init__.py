"""The true arm and the effects on it; shares no code with kinematics, effects and fits that are tested against it."""

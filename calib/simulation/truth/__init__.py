"""The true arm and the effects on it, without any code of the kinematics, effects and fits tested against them."""

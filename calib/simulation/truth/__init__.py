"""True arm of a simulation and the effects on it, without any code of the tested kinematics, effects and fits."""

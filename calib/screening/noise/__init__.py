"""The shape of the noise, fitted by likelihood to what a fit leaves over or to repeats."""

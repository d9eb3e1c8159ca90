"""Choice of the poses to measure next, and the error that a fit to them will have."""

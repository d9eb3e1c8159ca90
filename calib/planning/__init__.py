"""Which poses to measure: what each would tell, the best few, and the error that a fit of them will have."""

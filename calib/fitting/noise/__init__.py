"""What a shape of the noise (`calib.noise_shape`) means for measured points: covariances, correlation, weights."""

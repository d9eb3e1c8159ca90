"""What is told of a fit: its data, errors, parameters, curves and validation."""

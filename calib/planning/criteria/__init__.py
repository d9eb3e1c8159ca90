"""Design criteria other than a calibration: effect sizes, confounded effects, changes of a cell."""

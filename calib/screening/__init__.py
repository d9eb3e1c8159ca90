"""The residual of a fit, tested against every candidate effect, smooth motions of a joint, and noise of any shape."""

"""Tests of a fit's residual against every candidate effect, smooth motions of a joint, and noise of any shape."""

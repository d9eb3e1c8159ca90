"""The tabs of the step Learn."""

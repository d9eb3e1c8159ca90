"""The tabs of the step Model."""

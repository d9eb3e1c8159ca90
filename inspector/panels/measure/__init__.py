"""The tabs of the step Measure."""

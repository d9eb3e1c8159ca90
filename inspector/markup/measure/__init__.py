"""HTML for the tabs of the step Measure."""

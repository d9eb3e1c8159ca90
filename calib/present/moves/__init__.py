"""What is told of poses to come: plans, corrected targets and programs."""

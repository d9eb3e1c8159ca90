"""What is told of poses to come: plans and corrected targets."""

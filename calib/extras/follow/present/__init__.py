"""What is told of a campaign."""

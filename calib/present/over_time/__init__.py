"""What is told of a cell or a fleet over time: changes, checks, campaigns, types of arms."""

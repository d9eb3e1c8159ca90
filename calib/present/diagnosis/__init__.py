"""What is told of a diagnosis: effects, evidence, probabilities, the budget and what to do next."""
